"""``ProcessWorkers``: processes of this machine, which never outlive the one that started them.

Those of `concurrent.futures` outlive a parent that is killed, and break as a whole when one of them is killed.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from posture_opt.errors import InputError, Issue
from posture_opt.interrupts import undisturbed
from posture_opt.workers import Part, R, S, T, Workers, worked


@dataclass(frozen=True, eq=False)
class ProcessWorker:
    """One process and the pipe to it."""

    process: BaseProcess
    pipe: Connection

    @classmethod
    def started(cls) -> ProcessWorker:
        """A new process with its pipe, which waits for parts."""
        here, there = multiprocessing.Pipe()
        process = multiprocessing.Process(target=_serve_parts, args=(there, os.getpid()), daemon=True)
        with undisturbed():  # among what Python does at a fork an interrupt would be swallowed
            process.start()
        there.close()
        return cls(process, here)

    def end(self) -> None:
        """End it at once, whatever it does: it holds nothing that others need."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


class ProcessWorkers(Workers):
    """Works on ``count`` parts at once, each in a process of its own."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._idle: list[ProcessWorker] = []

    def run(self, part: Part[S, T, R], shared: S, items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """As of `Workers`."""
        waiting, lost = deque(range(len(items))), [0] * len(items)
        busy: dict[Connection, tuple[ProcessWorker, int]] = {}
        try:
            while waiting or busy:
                while waiting and len(busy) < self._count:
                    worker, k = self._idle.pop() if self._idle else ProcessWorker.started(), waiting.popleft()
                    busy[worker.pipe] = worker, k
                    _send_message(worker, (part, shared, items[k]))
                for pipe in wait(list(busy)):
                    worker, k = busy.pop(pipe)  # type: ignore[call-overload]
                    try:
                        done, result = worker.pipe.recv()
                    except (EOFError, OSError):
                        worker.end()
                        waiting.appendleft(k)
                        lost[k] += 1
                        if lost[k] == 3:  # then the part is taken for the cause
                            hint = "take fewer workers (--workers 1): most often memory is short"
                            text = "3 worker processes were ended over one part of the work"
                            raise InputError(Issue(text, hint=hint)) from None
                        continue
                    self._idle.append(worker)
                    if not done:
                        raise result
                    if waiting:
                        # Before anything is made of the result: no worker waits for that.
                        following = waiting.popleft()
                        busy[self._idle.pop().pipe] = worker, following
                        _send_message(worker, (part, shared, items[following]))
                    yield k, result
        finally:
            for worker, _ in busy.values():
                worker.end()

    def close(self) -> None:
        """End all processes."""
        while self._idle:
            self._idle.pop().end()


def _send_message(worker: ProcessWorker, message: tuple[Part[S, T, R], S, T]) -> None:
    """Send a part to a worker; that the worker has ended shows when its answer is read."""
    try:
        worker.pipe.send(message)
    except OSError:
        worker.process.join()


def _serve_parts(pipe: Connection, parent: int) -> None:
    """The loop of a worker: receive a part, compute it, send ``(True, result)`` or ``(False, error)``."""
    # An interrupt from the keyboard goes to all processes: the parent answers for them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ("SIGTERM", "SIGHUP", "SIGALRM"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_DFL)
    _end_with_parent(parent)
    while True:
        try:
            part, shared, item = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            message = True, worked(part, shared, item)
        except Exception as error:
            error.add_note("".join(traceback.format_exception(error)))
            message = False, error
        pipe.send(message)


def _end_with_parent(parent: int) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG of <sys/prctl.h>
    if os.getppid() != parent and multiprocessing.get_start_method() == "fork":
        os._exit(1)  # it ended before this was asked for
    parent_process = multiprocessing.parent_process()
    if parent_process is not None:
        threading.Thread(target=lambda: (wait([parent_process.sentinel]), os._exit(1)), daemon=True).start()
