"""A progress bar in one line of a terminal."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from typing import TextIO

DELAY = 2.0  # s; what is done by then needs no bar
PAUSE = 0.1  # s between two drawings: faster than this nobody reads
CELLS = 30


class ProgressBar:
    """Draws ``what: ███░░░ 12/50, 1:20 left`` over itself; nothing before ``DELAY`` seconds are over."""

    def __init__(self, what: str, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._what, self._stream, self._clock = what, stream, clock
        self._begun = clock()
        self._next = self._begun + DELAY
        self._drawn = 0

    def show(self, done: int, total: int) -> None:
        """Draw that ``done`` of ``total`` parts are done."""
        now = self._clock()
        if now < self._next or total <= 0:
            return
        self._next = now + PAUSE
        filled = CELLS * done // total
        left = f", {_minutes((now - self._begun) * (total - done) / done)} left" if done else ""
        self._draw(f"{self._what}: {'█' * filled}{'░' * (CELLS - filled)} {done}/{total}{left}")

    def clear(self) -> None:
        """Leave the line as it was found."""
        if self._drawn:
            self._draw("")
            self._stream.write("\r")
            self._stream.flush()

    def _draw(self, line: str) -> None:
        line = line[: shutil.get_terminal_size().columns - 1]
        self._stream.write("\r" + line.ljust(self._drawn))
        self._stream.flush()
        self._drawn = len(line)


def _minutes(seconds: float) -> str:
    return f"{round(seconds) // 60}:{round(seconds) % 60:02d}"
