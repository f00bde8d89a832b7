"""``MapCandidate``: what is known so far of one target of a map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from posture_opt.selection.search.engine import CandidatePosture

MapStatus = Literal["feasible", "not reached", "requirement not met"]


@dataclass(frozen=True)
class MapCandidate:
    """What was found for one target: a posture, or why there is none."""

    status: MapStatus
    best: CandidatePosture | None
    scale: float

    def packed(self) -> list[Any]:
        """Numbers and text, to be sent."""
        c = self.best
        if c is None:
            return [self.status, self.scale]
        numbers = (float(c.objective), float(c.violation), float(c.sigma))
        return [self.status, float(self.scale), c.q.tolist(), *numbers, bool(c.optimal), c.message, int(c.count)]

    @classmethod
    def unpacked(cls, row: list[Any]) -> MapCandidate:
        """The one that was packed."""
        status, scale, *best = row
        return cls(status, CandidatePosture(np.array(best[0]), *best[1:]) if best else None, scale)
