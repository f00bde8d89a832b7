"""``BenchMap``: the spread of the features over two coordinates of the placement.

For an engineer whose fixture cannot be put at the best place: what another one costs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.answer.combine import combined_sigma
from posture_opt.selection.answer.shared_placement import Placement
from posture_opt.selection.stations.placed_stations import PlacedStations, Postures

_RETRIES = 2  # times that placements of the map without a posture are tried again
_STARTS_PER_RETRY = 32  # random postures then
_NEIGHBOUR_PLACEMENTS = 8  # feasible placements whose postures are tried
_GRID_SIZE = 21  # placements along each side of the map


@dataclass(frozen=True)
class BenchMap:
    """The best spread over two coordinates of the placement, the others as in the answer.

    Args:
        axes: which two coordinates, 0 to 3.
        values: of each of them [m or rad].
        sigma: (len(values[0]), len(values[1])) [m]; NaN where a feature cannot be done.
    """

    axes: tuple[int, int]
    values: tuple[Array, Array]
    sigma: Array


@dataclass(frozen=True)
class PlacementOnBench(Placement):
    """A placement that can be mapped.

    Args:
        stations: the features in the frame of the workpiece.
    """

    stations: PlacedStations | None = None

    def bench(self, postures: Array) -> BenchMap | None:
        """The spread over the first two free coordinates, from the postures (K, n); None where fewer are free."""
        return None if self.stations is None else bench_map(self.stations, self.w, postures)


def bench_map(placed: PlacedStations, w: Array, postures: Array) -> BenchMap | None:
    """Over the first two free coordinates, the others as in the answer ``w`` (4,) with its postures (K, n).

    None where fewer than two coordinates are free.
    """
    free = np.flatnonzero(placed.placement.free)
    if len(free) < 2:
        return None
    first, second = int(free[0]), int(free[1])
    lower, upper = placed.placement.lower, placed.placement.upper
    values = [np.linspace(lower[i], upper[i], _GRID_SIZE) for i in (first, second)]
    W = np.tile(w, (_GRID_SIZE**2, 1))
    W[:, first], W[:, second] = (grid.ravel() for grid in np.meshgrid(*values, indexing="ij"))
    found = _spread_out(placed, placed.best(W, 8, np.random.default_rng(0), postures[None]))
    sigma = placement_sigma(placed, found).reshape(_GRID_SIZE, _GRID_SIZE)
    return BenchMap((first, second), (values[0], values[1]), np.where(np.isfinite(sigma), sigma, np.nan))


def _spread_out(placed: PlacedStations, found: Postures) -> Postures:
    """The same placements; those that lack a posture tried again, with the postures of feasible ones beside them.

    Few random starts miss what rare branches reach, and a map is to call nothing impossible that is not.
    """
    rng = np.random.default_rng(1)
    for _ in range(_RETRIES):
        feasible = (found.gap == 0).all(axis=1)
        bad, good = np.flatnonzero(~feasible), np.flatnonzero(feasible)
        if not len(bad) or not len(good):
            break
        away = np.linalg.norm(found.W[bad][:, None] - found.W[good][None], axis=2)
        beside = np.unique(good[np.argsort(away, axis=1)[:, :2]])
        known = found.Q[rng.permutation(beside)[:_NEIGHBOUR_PLACEMENTS]]
        better = placed.better(found.rows(bad), placed.best(found.W[bad], _STARTS_PER_RETRY, rng, known))
        parts: dict[str, Any] = {n: np.array(getattr(found, n)) for n in ("Q", "main", "extra", "sigma", "gap", "loss")}
        for name, part in parts.items():
            part[bad] = getattr(better, name)
        found = replace(found, **parts)
    return found


def placement_sigma(placed: PlacedStations, found: Postures) -> Array:
    """(M,) standard deviation [m] at each placement: of the worst feature, or the mean; infinite where one fails."""
    sigma = np.where(found.gap == 0, found.sigma, np.inf)
    return combined_sigma(placed.combine, sigma)
