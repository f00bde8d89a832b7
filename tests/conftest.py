"""Tests run with one thread for linear algebra (matrices are small here) and with one width of text."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Reports are as wide as the terminal: tests see what a pipe sees.
os.environ["COLUMNS"] = "100"
