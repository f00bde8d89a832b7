"""``OtherProcess``: what takes long is computed in a process of its own that can be stopped at any moment."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from typing import IO, Any

from posture_opt.errors import PostureOptError, SolverError
from posture_opt.numerics import Progress


class OtherProcess:
    """Computes in another process; one thing at a time, from one thread; `stop` and `end` from any."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._began: float | None = None
        self._stopped = self._ended = False
        self._guard = threading.Lock()

    def call(self, function: Callable[..., Any], *given: Any, progress: Progress | None = None) -> Any:
        """What ``function(*given)`` returns, or the `PostureOptError` that it raises; None where it was stopped.

        Args:
            progress: called with (done, most); the function takes what calls it as its last argument then.
        """
        self._stopped = False
        try:
            for _ in range(2):
                try:
                    return self._called(function, given, progress)
                except (OSError, EOFError, pickle.UnpicklingError):  # it ended by itself, or by somebody's hand
                    self._end()
                    if self._stopped:
                        return None
            return SolverError("the process that computes this was ended twice from outside")
        finally:
            self._began = None

    def _called(self, function: Callable[..., Any], given: tuple[Any, ...], progress: Progress | None) -> Any:
        with self._guard:
            self._stopped |= self._ended
            if self._stopped:
                raise EOFError
            process = self._process = self._process or _started()
            self._began = time.monotonic()
        assert process.stdin is not None
        assert process.stdout is not None
        _send(process.stdin, (function, given, progress is not None))
        while True:
            done, *said = pickle.load(process.stdout)
            if done:
                return said[0]
            if progress is not None:
                progress(*said)

    def stop_if_busy(self, since_s: float = 0.0) -> None:
        """End what has been under way for so many seconds, if something is; the next one begins in a new process."""
        began = self._began
        if began is not None and time.monotonic() - began >= since_s:
            self.stop()

    def stop(self) -> None:
        """End what is under way, and its process."""
        with self._guard:
            self._stopped = True
        self._end()

    def end(self) -> None:
        """Compute nothing more, whoever may ask: what is asked later has no answer."""
        self._ended = True
        self.stop()

    def _end(self) -> None:
        with self._guard:
            process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()


def _started() -> subprocess.Popen[bytes]:
    """A process that `serve`s: it can import what this one can, and nothing else in the folder that it starts in."""
    command = [sys.executable, "-P", "-c", "from posture_opt.explore.other_process import serve; serve()"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=paths)


def serve() -> None:
    """Answer calls from standard input until that ends."""
    given, answers = sys.stdin.buffer, sys.stdout.buffer
    sys.stdout = sys.stderr  # what libraries print must not run into the answers

    def progress(done: int, most: int) -> None:
        _send(answers, (False, done, most))

    while True:
        try:
            function, arguments, shows = pickle.load(given)
        except EOFError:
            return
        try:
            found = function(*arguments, *((progress,) if shows else ()))
        except PostureOptError as error:
            found = error
        except Exception as error:
            found = defect(error)
        _send(answers, (True, found))


def defect(error: Exception) -> SolverError:
    """An error that nobody raised on purpose, for the page to say."""
    said = traceback.format_exception_only(error)[-1].strip()
    return SolverError(f"this cannot be computed, by a defect of the program: {said}")


def _send(stream: IO[bytes], message: object) -> None:
    stream.write(pickle.dumps(message))
    stream.flush()
