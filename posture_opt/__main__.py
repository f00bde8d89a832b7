"""``python -m posture_opt`` and ``optimize-posture``: the command line, from its first import to the end."""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import sys
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from posture_opt.interrupts import interruptible


def run() -> NoReturn:
    """Run the command line; an interrupt ends it in one line, also while it is imported.

    Raises:
        SystemExit: always; the codes are 0 done, 1 a defect, 2 bad input, 3 no solution, 4 too few data, 130
            interrupted.
    """
    try:
        try:
            with interruptible():
                commands = import_module("posture_opt.cli.main")
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            sys.exit(130)
        commands.main()
    except SystemExit as leaving:
        # All is said: what interrupts now would only make the interpreter complain about its end.
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), signal.SIG_IGN)
        if isinstance(leaving.code, int) and leaving.code >= 128:  # by a signal, 128 + its number
            # Python would kill itself where an interrupt has hit ``exec``, and wait for threads.
            atexit._run_exitfuncs()  # folders for the time being are removed
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(OSError, ValueError):
                    stream.flush()
            os._exit(leaving.code)
        raise
    sys.exit(0)


def _leave_working_directory() -> None:
    """Take the working directory, which ``python -m`` puts first, off the way of imports and entry points.

    Data lie there, perhaps of others. Where this package itself lies in it, it comes last.
    """
    if sys.flags.safe_path or not sys.path or Path(sys.path[0]).resolve() != Path.cwd():
        return
    here = sys.path.pop(0)
    if Path(__file__).resolve().parents[1] == Path(here).resolve():
        sys.path.append(here)


if __name__ == "__main__":
    _leave_working_directory()
    run()
