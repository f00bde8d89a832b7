"""Standard streams that are closed, full or cut off, and requests to end: none of them is a defect of the program."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn, TextIO

_ENDING_SIGNALS = ("SIGTERM", "SIGHUP")
_INTERRUPT_EXIT_CODE = 130  # what a shell reports of a program that ^C ended


class Ended(KeyboardInterrupt):
    """Another program, or the terminal that closes, asks this one to end.

    Args:
        number: of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number: int = number


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP end the body as ^C does: what it began is cleaned up.

    Under ``nohup`` SIGHUP stays ignored, as does a signal that the caller handles already. In another thread than the
    main one signals cannot be handled, and nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, frame: FrameType | None) -> NoReturn:
        raise Ended(number)

    numbers = [getattr(signal, name) for name in _ENDING_SIGNALS if hasattr(signal, name)]
    former = {number: signal.getsignal(number) for number in numbers}
    heard = [number for number in numbers if former[number] == signal.SIG_DFL]
    for number in heard:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in heard:
            signal.signal(number, former[number])


def exit_code_of(interrupt: KeyboardInterrupt) -> int:
    """What a shell reports of a program that a signal ended: 128 + its number; 130 of Ctrl-C."""
    return 128 + interrupt.number if isinstance(interrupt, Ended) else _INTERRUPT_EXIT_CODE


def open_standard_streams() -> None:
    """Opens what the caller closed, so that no file of ours gets its number: writing to it fails, and says so.

    A terminal without σ or ° shows a question mark in its place instead of ending the program.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_WRONLY if number == 2 else os.O_RDONLY)
            os.set_inheritable(opened, True)
    sys.stdout, sys.stderr = _writable(sys.stdout, 1), _writable(sys.stderr, 2)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def _writable(stream: TextIO | None, number: int) -> TextIO:
    """A stream that takes text, also where the caller closed it or left it without a buffer."""
    if stream is None:
        return os.fdopen(number, "w", encoding="utf-8", closefd=False)
    if isinstance(getattr(stream, "buffer", None), io.RawIOBase):  # PYTHONUNBUFFERED: half a write would pass for all
        return os.fdopen(number, "w", encoding=stream.encoding, closefd=False)
    return stream


def output_fault(error: OSError) -> tuple[int, str]:
    """The exit code for what the system refused, and a message.

    A reader that closed the pipe is no error: code 0 without a message. All else is code 2 with file and reason.
    """
    if isinstance(error, BrokenPipeError):
        return 0, ""
    reason = "it is closed" if error.errno == errno.EBADF else error.strerror or str(error)
    return 2, f"cannot write to {error.filename or 'standard output'}: {reason}"


def discard(stream: TextIO | None) -> None:
    """Redirects a stream that takes nothing to the null device, so that what waits in its buffer does not fail again at
    exit.
    """
    with contextlib.suppress(OSError, ValueError, AttributeError):
        number = stream.fileno()  # type: ignore[union-attr]
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)
