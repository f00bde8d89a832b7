"""``interruptible``: Ctrl-C ends what is computed, also where compiled code swallows the exception."""

from __future__ import annotations

import _thread
import io
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ContextDecorator, contextmanager, suppress
from types import FrameType, TracebackType
from typing import Any

_SIGNAL_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGALRM", "SIGUSR1", "SIGUSR2")
"""Signals whose handlers may raise; those that a system lacks are skipped."""
_RAISE_AGAIN_S = 0.05
"""Period [s] after which an exception that was swallowed is raised again: unnoticed, yet time to clean up."""


class interruptible(ContextDecorator):  # noqa: N801 # it reads as what it makes of a function
    """What a signal handler raises within ends the body, whoever swallows it: with statement or decorator.

    CasADi runs Python's signal handlers in IPOPT's callbacks and while it converts arguments, and drops what they
    raise: a solve that Ctrl-C has stopped then looks like one that failed. Here the exception is raised again and
    again until it is on its way out, and at the latest at the end of the body. The handlers are those that were there:
    by default there is one, for Ctrl-C, which raises KeyboardInterrupt. Threads other than the main one get no
    signals. An inner one leaves everything to the outer one.

    Raises:
        KeyboardInterrupt: or whatever a handler raises.

    Example:
        >>> with interruptible():
        ...     print("IPOPT runs here")
        IPOPT runs here
    """

    def __init__(self) -> None:
        self._former: dict[int, Any] = {}
        self._raised: BaseException | None = None
        self._over = False
        self._sending = threading.Lock()

    def _recreate_cm(self) -> interruptible:
        """A new one for each call of a decorated function: it holds the state of one body."""
        return interruptible()

    def __enter__(self) -> None:
        if threading.current_thread() is not threading.main_thread():
            return
        handlers = {number: signal.getsignal(number) for number in _signal_numbers()}
        if any(isinstance(getattr(handler, "__self__", None), interruptible) for handler in handlers.values()):
            return
        self._stderr = sys.stderr
        self._former = {number: handler for number, handler in handlers.items() if callable(handler)}
        for number in self._former:
            signal.signal(number, self._handle_signal)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._over = True  # first of all: from here on, no handler raises
        with self._sending:
            pass
        for number, handler in self._former.items():
            signal.signal(number, handler)
        if self._raised is not None:
            sys.stderr = self._stderr
            if error is not self._raised:
                raise self._raised from None  # swallowed, or another error that follows from it

    def _handle_signal(self, number: int, frame: FrameType | None) -> None:
        """In place of the former handlers: calls the former one, and keeps raising what that has raised."""
        if self._raised is not None:
            if not (self._over or self._on_its_way()):
                raise self._raised
            return
        try:
            self._former[number](number, frame)
        except BaseException as error:
            self._raised = error
            if self._over:
                return
            sys.stderr = io.StringIO()  # where CasADi warns that it caught something
            # Not of `threading`, whose locks the interrupted code may hold.
            with suppress(RuntimeError):  # without memory for a thread it is raised once
                _thread.start_new_thread(self._send_again, (number,))
            raise

    def _on_its_way(self) -> bool:
        """Whether the interrupted code is handling the exception, in a ``finally`` say, and must have time to end."""
        error = sys.exception()
        while error is not None and error is not self._raised:
            error = error.__context__
        return error is not None

    def _send_again(self, number: int) -> None:
        """Sends the signal to the main thread again and again until the body is over; runs in a thread of its own."""
        main = threading.main_thread().ident
        assert main is not None
        while True:
            time.sleep(_RAISE_AGAIN_S)
            with self._sending:
                if self._over:
                    return
                if hasattr(signal, "pthread_kill"):
                    signal.pthread_kill(main, number)
                else:
                    _thread.interrupt_main(signal.Signals(number))


@contextmanager
def undisturbed() -> Iterator[None]:
    """Handlers of signals wait until the block, a short one, has ended; what arrived meanwhile is handled then.

    A mask of the main thread would not do: another thread takes the signal then, and the main one runs its handler.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    handlers = {number: signal.getsignal(number) for number in _signal_numbers()}
    former = {number: handler for number, handler in handlers.items() if callable(handler)}
    for number in former:
        signal.signal(number, lambda number, frame: waiting.append(number))
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
        for number in waiting:
            former[number](number, None)


def _signal_numbers() -> list[int]:
    """Numbers of the signals in ``_SIGNAL_NAMES`` that this system has."""
    return [int(getattr(signal, name)) for name in _SIGNAL_NAMES if hasattr(signal, name)]
