"""``WholeSearch``: the full search of `select_posture`, in a process of its own that can be stopped at any moment.

It must not slow down the loop that follows the mouse, and where nothing is feasible it looks for reasons for seconds.
IPOPT's linear solver is not thread-safe, so a second thread is no way.
"""

from __future__ import annotations

import os
import pickle
import struct
import subprocess
import sys
import threading
from typing import IO, Any, TypeAlias

from posture_opt.errors import PostureOptError
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.select_posture import select_posture

Found: TypeAlias = Solution | PostureOptError
_LENGTH = struct.Struct(">Q")  # bytes of the message that follows


class WholeSearch:
    """Searches in another process; one at a time, from one thread; `stop` from any."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._busy = False
        self._guard = threading.Lock()

    def solve(self, problem: ProblemData) -> Found | None:
        """What `select_posture` answers or raises; None where the search was stopped."""
        with self._guard:
            process = self._process = self._process or _started()
            self._busy = True
        try:
            assert process.stdin is not None
            assert process.stdout is not None
            _send(process.stdin, problem)
            found: Found = _receive(process.stdout)
            return found
        except (OSError, EOFError):
            self.stop()
            return None
        finally:
            self._busy = False

    def stop_if_busy(self) -> None:
        """End the search that is under way, if one is; the next one begins in a new process."""
        if self._busy:
            self.stop()

    def stop(self) -> None:
        """End the search that is under way, and its process."""
        with self._guard:
            process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()


def _started() -> subprocess.Popen[bytes]:
    """A process that `serve`s: it finds what this one can import, and nothing else in the folder that it starts in."""
    command = [sys.executable, "-P", "-c", "from posture_opt.explore.whole_search import serve; serve()"]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=paths)


def serve() -> None:
    """Answer problems from standard input until that ends."""
    given, answers = sys.stdin.buffer, sys.stdout.buffer
    sys.stdout = sys.stderr  # what libraries print must not run into the answers
    while True:
        try:
            problem = _receive(given)
        except EOFError:
            return
        _send(answers, _found(problem))


def _found(problem: ProblemData) -> Found:
    try:
        return select_posture(problem)
    except PostureOptError as error:
        return error


def _send(stream: IO[bytes], message: object) -> None:
    content = pickle.dumps(message)
    stream.write(_LENGTH.pack(len(content)) + content)
    stream.flush()


def _receive(stream: IO[bytes]) -> Any:
    """The next message of a process of our own.

    Raises:
        EOFError: the stream ended.
    """
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError
    content = stream.read(_LENGTH.unpack(head)[0])
    return pickle.loads(content)
