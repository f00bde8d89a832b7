"""Placements screened in batches, the best improved by IPOPT and solved again until one recurs; their map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.numerics import Array, Progress
from posture_opt.selection.answer.placement import BenchMap, Placement, combined_sigma
from posture_opt.selection.search.multistart import independent_batches, recurrences
from posture_opt.selection.stations.placed_stations import PlacedStations, Postures
from posture_opt.selection.stations.stations_problem import StationsOutcome, StationsPoint

_STARTS = 12
"""Random postures of a feature at a placement."""
_MAX_BATCHES = 10


@dataclass(frozen=True)
class PlacementOptimum:
    """A placement with its postures (one row), and whether IPOPT calls it optimal."""

    found: Postures
    objective: float
    optimal: bool
    count: int = 1

    @property
    def w(self) -> Array:
        """(4,) [m, rad]."""
        return np.asarray(self.found.W[0])

    @property
    def postures(self) -> Array:
        """(K, n) [rad or m]."""
        return np.asarray(self.found.Q[0])


@dataclass(frozen=True)
class PlacementSearch:
    """Result of a search for a placement."""

    stations: PlacedStations  # with the scale that the objectives are divided by
    optima: tuple[PlacementOptimum, ...]  # distinct ones, best first
    screened: Postures  # all placements that were looked at, with the best posture of each feature there
    batches: int  # of placements; recurred of them found the best optimum
    recurred: int
    solves: int  # of the joint problem


def search_placement(
    stations: PlacedStations, seed: int, workers: int = 1, progress: Progress | None = None,
    wanted: int | None = None, accepted: Callable[[PlacementOptimum], bool] | None = None,
) -> PlacementSearch:  # fmt: skip
    """Batches of placements until ``wanted`` of them find the best optimum, or it is not ``accepted``."""
    # A probability is smooth in the placement, which a largest spread is not.
    enough = wanted or (2 if stations.combine == "success" else 3)
    rng = np.random.default_rng([seed, _MAX_BATCHES])
    probe = stations.best(stations.in_plane(stations.placement.drawn(8, rng)), _STARTS, rng)
    stations = stations.scaled(stations.scale_of(probe))
    whole: PlacementSearch | None = None
    values: list[float] = []
    for found in independent_batches(_batch, (stations, seed), range(_MAX_BATCHES), workers):
        batch: PlacementSearch = replace(found, stations=stations)
        values.append(batch.optima[0].objective if batch.optima else np.inf)
        if whole is not None:
            optima = _distinct(stations, [*whole.optima, *batch.optima])
            screened, solves = whole.screened.joined(batch.screened), whole.solves + batch.solves
            batch = PlacementSearch(stations, optima, screened, 0, 0, solves)
        whole = batch
        if progress is not None:
            progress(len(values), _MAX_BATCHES)
        recurred = recurrences(values, _as_good)
        refused = accepted is not None and bool(whole.optima) and not accepted(whole.optima[0])
        if refused or recurred >= enough or (not whole.optima and len(values) >= 2):
            break
    assert whole is not None
    return replace(whole, batches=len(values), recurred=recurred)


def _batch(shared: tuple[PlacedStations, int], k: int) -> PlacementSearch:
    stations, seed = shared
    rng, box = np.random.default_rng([seed, k]), stations.placement
    count = 32 * max(int(box.free.sum()) - 1, 1)  # so many more for each free coordinate beyond two
    W = stations.in_plane(box.drawn(count, rng))
    if k == 0:
        W[0] = stations.in_plane(box.centre[None])[0]
    screened = _shared(stations, stations.best(W, _STARTS, rng), rng)
    for share in (0.3, 0.1):  # of the box, about those that fail least
        if np.isfinite(screened.loss).any():
            break
        order = np.argsort(failing(screened), kind="stable")[:4]
        W = np.vstack([box.near(screened.W[m], share, 12, rng) for m in order])
        screened = screened.joined(stations.best(stations.in_plane(W), _STARTS, rng, screened.Q[order]))
    optima, solves = _led(stations, _zoomed(stations, screened, rng), 2, rng)
    for share in (0.4, 0.1) if optima and box.free.any() else ():  # for branches that the way there did not see
        W = stations.in_plane(box.near(optima[0].w, share, 32, rng))
        nearby = stations.best(W, _STARTS, rng, optima[0].found.Q)
        if nearby.loss.min() < optima[0].objective:
            more, again = _led(stations, nearby, 1, rng)
            optima, solves = _distinct(stations, [*optima, *more]), solves + again
    return PlacementSearch(replace(stations, engines=()), optima, screened, 1, 1, solves)


def _zoomed(stations: PlacedStations, found: Postures, rng: np.random.Generator) -> Postures:
    for share, leads in ((0.25, 3), (0.08, 3)) if stations.placement.free.any() else ():
        best = _leading(stations, found, leads)
        if not best or not np.isfinite(found.loss[best]).all():
            break
        W = np.vstack([stations.placement.near(found.W[m], share, 12, rng) for m in best])
        found = found.joined(stations.best(stations.in_plane(W), 4, rng, found.Q[best]))
    return found


def _led(
    stations: PlacedStations, found: Postures, most: int, rng: np.random.Generator
) -> tuple[tuple[PlacementOptimum, ...], int]:
    leads = _leading(stations, found, most if stations.placement.free.any() else 1)
    starts = [(m, stations.joint.solve(StationsPoint(found.W[m], found.Q[m]))) for m in leads]
    ends = [_improved(stations, found.rows(np.array([m])), end, rng) for m, end in starts]
    solves = len(starts) + sum(more for _, more in ends)
    return _distinct(stations, [end for end, _ in ends if end is not None]), solves


def _shared(stations: PlacedStations, found: Postures, rng: np.random.Generator) -> Postures:
    best = [m for m in np.argsort(found.loss, kind="stable")[:2] if np.isfinite(found.loss[m])]
    if not best or np.isfinite(found.loss).mean() > 0.75:
        return found
    failed = np.flatnonzero(~np.isfinite(found.loss))
    again = stations.better(found.rows(failed), stations.best(found.W[failed], 0, rng, found.Q[best]))
    return found.replaced(failed, again)


def failing(found: Postures) -> Array:
    """(M,) how much placements fail: features without a posture, then by how much they miss one."""
    missing = found.gap > 0
    return np.asarray(missing.sum(axis=1) + np.minimum(found.gap, 1.0).sum(axis=1) / (1 + found.gap.shape[1]))


def _size(stations: PlacedStations) -> Array:
    """(4,) of the box; one of fixed coordinates."""
    box = stations.placement
    return np.where(box.free, box.upper - box.lower, 1.0)


def _leading(stations: PlacedStations, found: Postures, most: int) -> list[int]:
    values = found.loss
    feasible = np.isfinite(values)
    order = np.argsort(values if feasible.any() else failing(found), kind="stable")
    size = _size(stations)
    chosen: list[int] = []
    for m in order[: int(feasible.sum())] if feasible.any() else order:
        # Nearer ones, as a share of the box, lead to one optimum.
        apart = [np.max(np.abs(found.W[m] - found.W[c]) / size) > 0.15 for c in chosen]
        if all(apart) and np.isfinite(found.Q[m]).all():
            chosen.append(int(m))
        if len(chosen) == most:
            break
    return chosen


def _improved(
    stations: PlacedStations, start: Postures, end: StationsOutcome, rng: np.random.Generator
) -> tuple[PlacementOptimum | None, int]:
    best, value, optimal, solves = start, float(start.loss[0]), False, 0
    for _ in range(4):
        if not np.all(np.isfinite(end.point.Q)):
            break
        w = stations.placement.tidied(end.point.w)
        found = stations.best(w[None], 64, rng, end.point.Q[None])
        now = float(found.loss[0])
        gained = not np.isfinite(value) or _as_good(now) < value
        if now < value:
            best, value, optimal = found, now, end.optimal
        if not gained:
            optimal = optimal or (end.optimal and np.isfinite(now) and value <= _as_good(now))
            break
        end, solves = stations.joint.solve(StationsPoint(found.W[0], found.Q[0])), solves + 1
    return (PlacementOptimum(best, value, optimal) if np.isfinite(value) else None), solves


def _as_good(best: float) -> float:
    return best + 1e-3 * max(1.0, abs(best))  # of a variance: half as much of σ, which is not measurable


def _distinct(stations: PlacedStations, optima: list[PlacementOptimum]) -> tuple[PlacementOptimum, ...]:
    size = _size(stations)
    kept: list[PlacementOptimum] = []
    least = min((optimum.objective for optimum in optima), default=0.0)
    tie = least + 3e-5 * max(1.0, abs(least))  # rounding of the placement
    centre = stations.placement.centre

    def rank(o: PlacementOptimum) -> tuple[float, float, tuple[float, ...]]:
        """Of equal placements, the one nearest to the centre, then that of larger coordinates."""
        away = round(float(np.linalg.norm((o.w - centre) / size)), 3)
        return max(o.objective, tie), away, tuple(-np.round(o.w, 3))

    for optimum in sorted(optima, key=rank):
        same = [i for i, o in enumerate(kept) if np.max(np.abs(o.w - optimum.w) / size) < 0.02]
        if same:
            kept[same[0]] = replace(kept[same[0]], count=kept[same[0]].count + optimum.count)
        else:
            kept.append(optimum)
    return tuple(kept)


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
