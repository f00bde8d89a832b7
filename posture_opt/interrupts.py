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


class interruptible(ContextDecorator):  # noqa: N801 # it reads as what it makes of a function
    """What a signal handler raises within ends the body, whoever swallows it: with statement or decorator.

    CasADi runs Python's signal handlers in IPOPT's callbacks and while it converts arguments, and drops what they
    raise: a solve that Ctrl-C has stopped then looks like one that failed. Here the exception is raised again and
    again until it is on its way out, at the latest at the end of the body. The handlers are those that were there.
    Threads other than the main one get no signals. An inner one leaves everything to the outer one.

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
        return interruptible()  # the state is that of one call of a decorated function

    def __enter__(self) -> None:
        if threading.current_thread() is not threading.main_thread():
            return
        handlers = _handlers()
        if any(isinstance(getattr(handler, "__self__", None), interruptible) for handler in handlers.values()):
            return
        self._stderr, self._former = sys.stderr, handlers
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
        main = threading.main_thread().ident
        assert main is not None
        while True:
            time.sleep(0.05)  # unnoticed, yet time to clean up
            with self._sending:
                if self._over:
                    return
                if hasattr(signal, "pthread_kill"):
                    signal.pthread_kill(main, number)
                else:
                    _thread.interrupt_main(signal.Signals(number))


@contextmanager
def undisturbed() -> Iterator[None]:
    """Have handlers of signals wait until the block, a short one, has ended.

    A mask of the main thread would not do: another thread takes the signal then, and the main one runs its handler.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    former = _handlers()
    for number in former:
        signal.signal(number, lambda number, frame: waiting.append(number))
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
        for number in waiting:
            former[number](number, None)


def _handlers() -> dict[int, Any]:
    """Number -> handler of the signals whose handlers may raise, of those that this system has."""
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGALRM", "SIGUSR1", "SIGUSR2")
    found = {int(getattr(signal, n)): signal.getsignal(getattr(signal, n)) for n in names if hasattr(signal, n)}
    return {number: handler for number, handler in found.items() if callable(handler)}
