"""``Evidence``: how an answer was searched for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from posture_opt.selection.multistart import Sampled
from posture_opt.selection.sweep import Sweep


@dataclass(frozen=True)
class Evidence:
    """How the answer was searched for.

    Args:
        tried: random postures that were led towards the target.
        starts: those of them that arrived, with the tool axis as it should be.
        polished: local solves; ``converged`` of them by the solver's own word.
        distinct: different local optima among them; ``hits`` of the polished starts ended at the best one.
        sampled: those of these that meet all further requirements too.
        sweep: a systematic sweep beside the random starts, or None; ``sweep_sigma`` its best [m].
        seconds: wall time.
    """

    starts: int
    tried: int
    polished: int
    converged: int
    distinct: int
    hits: int
    sampled: Sampled
    sweep: Sweep | None
    sweep_sigma: float
    seconds: float

    @property
    def feasible(self) -> int:
        """How many starts met every requirement."""
        return len(self.sampled.Q)

    @property
    def typical(self) -> float:
        """σ_max [m], median over the distinct feasible starts; NaN where there are none."""
        return self.sampled.typical

    @property
    def worst(self) -> float:
        """σ_max [m] of the worst feasible start; NaN where there are none."""
        return self.sampled.worst

    def to_json(self) -> dict[str, Any]:
        """The part ``solver`` of ``solution.json``."""
        counts = ("starts", "feasible", "tried", "polished", "converged", "distinct", "hits", "seconds")
        return {name: getattr(self, name) for name in counts}
