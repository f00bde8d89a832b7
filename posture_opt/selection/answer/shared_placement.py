"""``Placement``: where a workpiece was put within its range, and what other placements cost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from posture_opt.numerics import Array, finite_or_none
from posture_opt.selection.answer.placement import PlacementRange, placement_json


@dataclass(frozen=True)
class PlacementFigure:
    """What one placement costs.

    Args:
        w: (4,) x, y, z [m] and yaw [rad] of the workpiece, world.
        sigma: [m] of the worst station there, or the mean of all; infinite where one cannot be done.
        success: probability that all stations succeed, where that is what counts.
    """

    w: Array
    sigma: float
    success: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, SI; no spread where a station cannot be done."""
        figures = {"sigma": finite_or_none(self.sigma), "success_all": self.success}
        return {"workpiece": placement_json(self.w), **figures}


@dataclass(frozen=True)
class PlacementStatistics:
    """How the placement was searched for.

    Args:
        placements: that were looked at; ``feasible`` of them have a posture for every station.
        starts: random postures that were led to stations.
        solves: of the program of all stations.
        batches: independent ones; ``recurred`` of them found the best optimum.
        seconds: wall time.
    """

    placements: int
    feasible: int
    starts: int
    solves: int
    batches: int
    recurred: int
    seconds: float


@dataclass(frozen=True)
class Placement(PlacementRange):
    """The placement that the stations of an answer share, in the range where the workpiece may stand.

    Args:
        w: (4,) x, y, z [m] and yaw [rad] of the workpiece, world.
        statistics: of the search for it; None where it was searched for with its path.
        at_centre, typical: the middle of the range, and the median of random placements at which every station can be
            done; None where the placement is fixed or there is none.
        others: further optima, best first.
    """

    w: Array
    statistics: PlacementStatistics | None = None
    at_centre: PlacementFigure | None = None
    typical: PlacementFigure | None = None
    others: tuple[PlacementFigure, ...] = ()

    @property
    def workpiece(self) -> dict[str, float]:
        """x, y, z [m] and yaw [rad] of the workpiece, by name."""
        return placement_json(self.w)

    @property
    def central(self) -> float:
        """Standard deviation [m] in the middle of the range; NaN where that was not tried, or is not feasible."""
        return math.nan if self.at_centre is None else self.at_centre.sigma

    @property
    def search_json(self) -> dict[str, Any]:
        """What the part ``solver`` of ``solution.json`` says of the search for it."""
        return {} if self.statistics is None else vars(self.statistics)

    def bench(self, postures: Array) -> Any:
        """A map of the spread over the placement, from the postures (K, n) of an answer; None where none is made."""
        return None

    def to_json(self) -> dict[str, Any]:
        """The part ``placements`` of ``solution.json``."""
        return {
            "centre": None if self.at_centre is None else self.at_centre.to_json(),
            "typical": None if self.typical is None else self.typical.to_json(),
            "others": [other.to_json() for other in self.others],
        }
