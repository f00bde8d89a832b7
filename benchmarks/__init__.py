"""posture_opt beside its peers: every way on the same targets, in one run, on one machine."""

import os

# One thread for every way: NumPy's BLAS threads only cost time on matrices this small, and blur the CPU times.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
