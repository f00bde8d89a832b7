"""``ProcessWorkers``: processes of this machine, which never outlive the one that started them.

The processes of `concurrent.futures` outlive a parent that is killed, and when one of them is killed the whole pool is
broken. These end with their parent, are not disturbed by an interrupt that it answers, and one that is lost is replaced
and its part begun again.
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
from typing import Any

from posture_opt.errors import InputError, Issue
from posture_opt.interrupts import undisturbed
from posture_opt.workers.workers import Part, Workers, worked

_MOST_LOST = 3  # workers that may be lost over one part, before it is to blame
_DEATH_OF_PARENT = 1  # PR_SET_PDEATHSIG of <sys/prctl.h>


@dataclass(frozen=True, eq=False)
class ProcessWorker:
    """One process and the pipe to it."""

    process: BaseProcess
    pipe: Connection

    @classmethod
    def started(cls) -> ProcessWorker:
        """A new one."""
        here, there = multiprocessing.Pipe()
        process = multiprocessing.Process(target=_serve, args=(there, os.getpid()), daemon=True)
        with undisturbed():  # among what Python does at a fork an interrupt would be swallowed
            process.start()
        there.close()
        return cls(process, here)

    def end(self) -> None:
        """At once, whatever it does: it holds nothing that others need."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


class ProcessWorkers(Workers):
    """Works on ``count`` parts at once, each in a process of its own."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._idle: list[ProcessWorker] = []

    def run(self, part: Part, shared: Any, items: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """As of `Workers`.

        Raises:
            InputError: a part ended three processes that worked on it.
        """
        waiting, lost = deque(range(len(items))), [0] * len(items)
        busy: dict[Connection, tuple[ProcessWorker, int]] = {}
        try:
            while waiting or busy:
                while waiting and len(busy) < self._count:
                    worker, k = self._idle.pop() if self._idle else ProcessWorker.started(), waiting.popleft()
                    busy[worker.pipe] = worker, k
                    _send(worker, (part, shared, items[k]))
                for pipe in wait(list(busy)):
                    worker, k = busy.pop(pipe)  # type: ignore[call-overload]
                    try:
                        done, result = worker.pipe.recv()
                    except (EOFError, OSError):
                        worker.end()
                        waiting.appendleft(k)
                        lost[k] = _counted(lost[k])
                        continue
                    self._idle.append(worker)
                    if not done:
                        raise result
                    if waiting:
                        # Before anything is made of the result: no worker waits for that.
                        following = waiting.popleft()
                        busy[self._idle.pop().pipe] = worker, following
                        _send(worker, (part, shared, items[following]))
                    yield k, result
        finally:
            for worker, _ in busy.values():
                worker.end()

    def close(self) -> None:
        """End all processes."""
        while self._idle:
            self._idle.pop().end()


def _send(worker: ProcessWorker, message: Any) -> None:
    try:
        worker.pipe.send(message)
    except OSError:
        worker.process.join()  # it has ended: reading from it will tell


def _counted(lost: int) -> int:
    if lost + 1 < _MOST_LOST:
        return lost + 1
    hint = "take fewer workers (--workers 1): most often memory is short"
    raise InputError(Issue(f"{_MOST_LOST} worker processes were ended over one part of the work", hint=hint))


def _serve(pipe: Connection, parent: int) -> None:
    """What a worker does, until it is ended."""
    # An interrupt from the keyboard goes to all processes: the parent answers for them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in ("SIGTERM", "SIGHUP", "SIGALRM"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_DFL)
    _end_with(parent)
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


def _end_with(parent: int) -> None:
    """Make sure that this process does not outlive its parent."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DEATH_OF_PARENT, signal.SIGKILL)
    if os.getppid() != parent and multiprocessing.get_start_method() == "fork":
        os._exit(1)  # it ended before this was asked for
    parent_process = multiprocessing.parent_process()
    if parent_process is not None:
        threading.Thread(target=lambda: (wait([parent_process.sentinel]), os._exit(1)), daemon=True).start()
