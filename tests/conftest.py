"""One thread for linear algebra: matrices are small here, and threads that wait for each other cost tenfold."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
