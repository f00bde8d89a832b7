"""How far along a work of several stages is, in parts of a hundred."""

from __future__ import annotations

from collections.abc import Callable

from posture_opt.numerics import Progress

PROGRESS_TOTAL = 100


class Stages:
    """Shares a bar between stages of known shares; within a stage steps are reported as so many of so many.

    Args:
        progress: receives (done, 100); None for no report.
        shares: of each stage, in the order in which they come.
    """

    def __init__(self, progress: Progress | None, *shares: int) -> None:
        self._progress, self._shares, self._done = progress, list(shares), 0

    def next(self) -> Progress:
        """Ends the stage before and begins the next one, whose steps are reported to what is returned."""
        begin, share = self._done, self._shares.pop(0)
        self._done += share
        self._report(begin)

        def report_step(done: int, total: int) -> None:
            self._report(begin + share * min(done, total) // max(total, 1))

        return report_step

    def rounds(self, progress: Progress) -> Callable[[], None]:
        """Reports rounds whose number is unknown: each takes a third of what is left of the stage."""
        left = 1.0

        def next_round() -> None:
            nonlocal left
            left *= 2 / 3
            progress(round(1000 * (1 - left)), 1000)

        return next_round

    def end(self) -> None:
        """All is done."""
        self._report(PROGRESS_TOTAL)

    def _report(self, done: int) -> None:
        """Reports a part of `PROGRESS_TOTAL`, where somebody looks."""
        if self._progress is not None:
            self._progress(done, PROGRESS_TOTAL)
