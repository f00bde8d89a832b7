"""``MapCandidate``: what is known so far of one target of a map.

A map is worked on in rounds by several workers; between them candidates travel as plain numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from posture_opt.selection.search.engine import CandidatePosture
from posture_opt.workers.record_pattern import FINITE, Either, Pattern

PackedRow = list[Any]
"""Numbers, texts and lists of them in an order that their class knows, as they travel between processes."""

MapStatus = Literal["feasible", "not reached", "requirement not met"]


@dataclass(frozen=True)
class MapCandidate:
    """What was found for one target of a map.

    Args:
        status: ``feasible``; ``not reached``: no start arrived; ``requirement not met``: some arrived, but collide or
            miss a term.
        best: the best posture, None where there is none.
        scale: variance [m²] that its objective is divided by; NaN where no start arrived.
    """

    status: MapStatus
    best: CandidatePosture | None
    scale: float

    def packed(self) -> PackedRow:
        """Numbers and text, to be sent to another process or written to a checkpoint."""
        c = self.best
        if c is None:
            return [self.status, self.scale]
        numbers = (float(c.objective), float(c.violation), float(c.sigma))
        return [self.status, float(self.scale), c.q.tolist(), *numbers, bool(c.optimal), c.message, int(c.count)]

    @staticmethod
    def pattern(joints: int) -> Pattern:
        """That of `packed`, of an arm with so many joints."""
        found = (frozenset(["feasible"]), float, (FINITE,) * joints, *(float,) * 3, bool, str, int)
        return Either(found, (frozenset(get_args(MapStatus)) - {"feasible"}, float))

    @classmethod
    def unpacked(cls, row: PackedRow) -> MapCandidate:
        """The one that was packed."""
        status, scale, *best = row
        return cls(status, CandidatePosture(np.array(best[0]), *best[1:]) if best else None, scale)
