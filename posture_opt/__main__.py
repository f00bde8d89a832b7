"""``python -m posture_opt`` and ``optimize-posture``: the command line, from its first import to the end."""

from __future__ import annotations

import signal
import sys
from importlib import import_module
from typing import NoReturn

from posture_opt.interrupts import interruptible


def run() -> NoReturn:
    """Run the command line; an interrupt ends it in one line, also while it is imported."""
    try:
        with interruptible():
            commands = import_module("posture_opt.cli.main")
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    try:
        commands.main()
    finally:
        # All is said: what interrupts now would only make the interpreter complain about its end.
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), signal.SIG_IGN)
    sys.exit(0)


if __name__ == "__main__":
    run()
