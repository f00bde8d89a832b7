"""How far along a work of several stages is, told in parts of a hundred."""

from __future__ import annotations

from collections.abc import Callable

from posture_opt.numerics import Progress

PROGRESS_TOTAL = 100


class Stages:
    """Shares a bar between stages of known shares; within a stage so many of so many steps are told.

    Args:
        progress: is told (done, 100); None where nobody looks.
        shares: of each stage, in the order in which they come.
    """

    def __init__(self, progress: Progress | None, *shares: int) -> None:
        self._progress, self._shares, self._done = progress, list(shares), 0

    def next(self) -> Progress:
        """Ends the stage before and begins the next one, whose steps are told by what is returned."""
        begin, share = self._done, self._shares.pop(0)
        self._done += share
        self._tell(begin)

        def tell(done: int, total: int) -> None:
            self._tell(begin + share * min(done, total) // max(total, 1))

        return tell

    def rounds(self, tell: Progress) -> Callable[[], None]:
        """Tells rounds whose number nobody knows: each takes a third of what is left of the stage."""
        left = 1.0

        def told() -> None:
            nonlocal left
            left *= 2 / 3
            tell(round(1000 * (1 - left)), 1000)

        return told

    def end(self) -> None:
        """All is done."""
        self._tell(PROGRESS_TOTAL)

    def _tell(self, done: int) -> None:
        """Reports a part of `PROGRESS_TOTAL`, where somebody looks."""
        if self._progress is not None:
            self._progress(done, PROGRESS_TOTAL)
