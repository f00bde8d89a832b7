"""Tests run with one thread for linear algebra (matrices are small here), one width of text, and signals that act."""

import os
import signal

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Reports are as wide as the terminal: tests see what a pipe sees.
os.environ["COLUMNS"] = "100"

# A shell starts what runs in the background with interrupts ignored, and `nohup` with hang-ups; programs that tests
# start would inherit that.
for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)
