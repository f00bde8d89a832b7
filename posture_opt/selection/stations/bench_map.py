"""Spread of the features over two coordinates of the placement: what another place of the fixture costs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.answer.placement import Placement, combined_sigma
from posture_opt.selection.stations.placed_stations import PlacedStations, Postures


@dataclass(frozen=True)
class BenchMap:
    """Best spread over two coordinates of the placement, the others as in the answer."""

    axes: tuple[int, int]  # which two coordinates, 0 to 3
    values: tuple[Array, Array]  # of each of them [m or rad]
    sigma: Array  # (len(values[0]), len(values[1])) [m]; NaN where a feature cannot be done


@dataclass(frozen=True)
class PlacementOnBench(Placement):
    """A placement that can be mapped."""

    stations: PlacedStations | None = None  # the features in the frame of the workpiece

    def bench(self, postures: Array) -> BenchMap | None:
        """Spread over the first two free coordinates, from postures (K, n); None where fewer are free."""
        return None if self.stations is None else _bench_map(self.stations, self.w, postures)


def _bench_map(placed: PlacedStations, w: Array, postures: Array) -> BenchMap | None:
    free = np.flatnonzero(placed.placement.free)
    if len(free) < 2:
        return None
    first, second = int(free[0]), int(free[1])
    lower, upper = placed.placement.lower, placed.placement.upper
    size = 21  # placements along each side
    values = [np.linspace(lower[i], upper[i], size) for i in (first, second)]
    W = np.tile(w, (size**2, 1))
    W[:, first], W[:, second] = (grid.ravel() for grid in np.meshgrid(*values, indexing="ij"))
    found = _spread_out(placed, placed.best(W, 8, np.random.default_rng(0), postures[None]))
    sigma = placement_sigma(placed, found).reshape(size, size)
    return BenchMap((first, second), (values[0], values[1]), np.where(np.isfinite(sigma), sigma, np.nan))


def _spread_out(placed: PlacedStations, found: Postures) -> Postures:
    rng = np.random.default_rng(1)
    for _ in range(2):
        feasible = (found.gap == 0).all(axis=1)
        bad, good = np.flatnonzero(~feasible), np.flatnonzero(feasible)
        if not len(bad) or not len(good):
            break
        away = np.linalg.norm(found.W[bad][:, None] - found.W[good][None], axis=2)
        beside = np.unique(good[np.argsort(away, axis=1)[:, :2]])
        known = found.Q[rng.permutation(beside)[:8]]
        found = found.replaced(bad, placed.better(found.rows(bad), placed.best(found.W[bad], 32, rng, known)))
    return found


def placement_sigma(placed: PlacedStations, found: Postures) -> Array:
    """(M,) standard deviation [m] of the worst feature, or the mean; infinite where one fails."""
    sigma = np.where(found.gap == 0, found.sigma, np.inf)
    return combined_sigma(placed.combine, sigma)
