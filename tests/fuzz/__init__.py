"""Random input against the command line: every case ends with an answer or with a message, never with a defect."""

import os

# Threads of BLAS reserve addresses, of which a case has few.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
