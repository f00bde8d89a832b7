"""Where to put a workpiece: many placements screened, the best of them improved by IPOPT, again until it recurs.

A placement has at most four coordinates, and at each the features are single problems. So batches of placements that
fill the box are solved feature by feature; the best few lead the joint problem, which moves the placement and all
postures together; after it every feature is solved again from random starts, lest another branch be better there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.numerics import Array, Progress
from posture_opt.selection.search.batches import independent_batches, recurrences
from posture_opt.selection.stations.placed_stations import PlacedStations, Postures
from posture_opt.selection.stations.stations_problem import StationsOutcome, StationsPoint

_PLACEMENTS_PER_BATCH = 32  # of a batch, and so many more for each free coordinate beyond two
_STARTS_PER_PLACEMENT = 12  # random postures of a feature at a placement
_STARTS_AT_OPTIMUM = 64  # where the joint problem has ended
_ZOOMS = ((0.25, 3), (0.08, 3))  # of the box, and the placements of a batch about which it is searched
_PLACEMENTS_PER_ZOOM = 12  # about each
_STARTS_PER_ZOOM = 4  # random postures of a feature there, beside those of the best placements
_SOLVES_PER_BATCH = 2  # placements of a batch that lead the joint problem
_HOP_SHARES = (0.4, 0.1)  # of the box: a better placement about the optimum leads the joint problem in its turn
_PLACEMENTS_PER_HOP = 32  # of them
_SHARED_BELOW = 0.75  # share of the placements that are feasible: below it, the others are tried again
_MAX_ROUNDS = 4  # of joint problem and single problems in turn
_MIN_DISTANCE_SHARE = 0.15  # of the box: placements that are nearer lead to the same optimum
_OBJECTIVE_TOLERANCE = (
    1e-3  # of the objective, a variance: half as much of a standard deviation, which is not measurable
)
_ROUNDING_TOLERANCE = 3e-5  # of the objective: less is the rounding of the placement
_BATCHES_THAT_FIND_IT = 3  # the best optimum
_BATCHES_FOR_SUCCESS = 2  # a probability is smooth in the placement, which a largest spread is not
_MAX_BATCHES = 10  # batches
_NEARER_SHARES = (0.3, 0.1)  # of the box, about the placements that came nearest, where no placement is feasible
_MAX_FAILED_BATCHES = 2  # batches without any feasible placement, after which there is none


@dataclass(frozen=True)
class PlacementOptimum:
    """A placement with its postures (one row), the objective there, and whether IPOPT calls it optimal."""

    found: Postures
    objective: float
    optimal: bool
    count: int = 1

    @property
    def w(self) -> Array:
        """(4,) the placement."""
        return np.asarray(self.found.W[0])

    @property
    def postures(self) -> Array:
        """(K, n) of the stations."""
        return np.asarray(self.found.Q[0])


@dataclass(frozen=True)
class PlacementSearch:
    """What a search for a placement found.

    Args:
        stations: with the scale that the objectives are divided by.
        optima: distinct ones, best first.
        screened: all placements that were looked at, with the best posture of each feature there.
        batches: of placements; ``recurred`` of them found the best optimum.
        solves: of the joint problem.
    """

    stations: PlacedStations
    optima: tuple[PlacementOptimum, ...]
    screened: Postures
    batches: int
    recurred: int
    solves: int


def search_placement(
    stations: PlacedStations,
    seed: int,
    workers: int = 1,
    progress: Progress | None = None,
    wanted: int | None = None,
    accepted: Callable[[PlacementOptimum], bool] | None = None,
) -> PlacementSearch:
    """Batches of placements until the best optimum has been found by some of them.

    Args:
        stations: with any scale.
        workers: processes that share the batches; the answer does not depend on it.
        progress: called with (done, most) batches.
        wanted: batches that are to find the best optimum; default three, or two where what counts is that all succeed.
        accepted: whether the best optimum is one that is asked for; the search ends as soon as it is not.
    """
    usual = _BATCHES_FOR_SUCCESS if stations.combine == "success" else _BATCHES_THAT_FIND_IT
    enough = usual if wanted is None else wanted
    rng = np.random.default_rng([seed, _MAX_BATCHES])
    probe = stations.best(stations.in_plane(stations.placement.drawn(8, rng)), _STARTS_PER_PLACEMENT, rng)
    stations = stations.scaled(stations.scale_of(probe))
    whole: PlacementSearch | None = None
    values: list[float] = []
    for found in independent_batches(_batch, (stations, seed), range(_MAX_BATCHES), workers):
        batch: PlacementSearch = replace(found, stations=stations)
        whole = batch if whole is None else _joined(whole, batch)
        values.append(batch.optima[0].objective if batch.optima else np.inf)
        if progress is not None:
            progress(len(values), _MAX_BATCHES)
        recurred = recurrences(values, _as_good)
        refused = accepted is not None and bool(whole.optima) and not accepted(whole.optima[0])
        if refused or recurred >= enough or (not whole.optima and len(values) >= _MAX_FAILED_BATCHES):
            break
    assert whole is not None
    return replace(whole, batches=len(values), recurred=recurred)


def _joined(one: PlacementSearch, other: PlacementSearch) -> PlacementSearch:
    """Two searches of the same stations as one."""
    optima = _distinct(one.stations, [*one.optima, *other.optima])
    return PlacementSearch(one.stations, optima, one.screened.joined(other.screened), 0, 0, one.solves + other.solves)


def _batch(shared: tuple[PlacedStations, int], k: int) -> PlacementSearch:
    """Batch k, without the engines: they need not travel back."""
    stations, seed = shared
    found = one_batch(stations, seed, k)
    return replace(found, stations=replace(found.stations, engines=()))  # they need not travel back


def one_batch(stations: PlacedStations, seed: int, k: int) -> PlacementSearch:
    """One batch: placements that fill the box, the best of them improved."""
    rng = np.random.default_rng([seed, k])
    count = _PLACEMENTS_PER_BATCH * max(int(stations.placement.free.sum()) - 1, 1)
    W = stations.in_plane(stations.placement.drawn(count, rng))
    if k == 0:
        W[0] = stations.in_plane(stations.placement.centre[None])[0]
    screened = _shared(stations, stations.best(W, _STARTS_PER_PLACEMENT, rng), rng)
    for share in _NEARER_SHARES:
        if np.isfinite(screened.loss).any():
            break
        screened = _nearer(stations, screened, share, rng)
    optima, solves = _led(stations, _zoomed(stations, screened, rng), _SOLVES_PER_BATCH, rng)
    for share in _HOP_SHARES if optima and stations.placement.free.any() else ():
        nearby = _around(stations, optima[0], share, rng)
        if nearby.loss.min() < optima[0].objective:
            more, again = _led(stations, nearby, 1, rng)
            optima, solves = _distinct(stations, [*optima, *more]), solves + again
    return PlacementSearch(stations, optima, screened, 1, 1, solves)


def _zoomed(stations: PlacedStations, found: Postures, rng: np.random.Generator) -> Postures:
    """The placements and others about the best of them, in boxes that get smaller.

    Features are solved at some tens of placements in the time that the joint problem takes to be solved once.
    """
    for share, leads in _ZOOMS if stations.placement.free.any() else ():
        best = _leading(stations, found, leads)
        if not best or not np.isfinite(found.loss[best]).all():
            break
        W = np.vstack([stations.placement.near(found.W[m], share, _PLACEMENTS_PER_ZOOM, rng) for m in best])
        found = found.joined(stations.best(stations.in_plane(W), _STARTS_PER_ZOOM, rng, found.Q[best]))
    return found


def _led(
    stations: PlacedStations, found: Postures, most: int, rng: np.random.Generator
) -> tuple[tuple[PlacementOptimum, ...], int]:
    """The optima that the best few of some placements lead to, and the number of solves of the joint problem."""
    leads = _leading(stations, found, most if stations.placement.free.any() else 1)
    starts = [(m, stations.joint.solve(StationsPoint(found.W[m], found.Q[m]))) for m in leads]
    ends = [_improved(stations, found.rows(np.array([m])), end, rng) for m, end in starts]
    solves = len(starts) + sum(more for _, more in ends)
    return _distinct(stations, [end for end, _ in ends if end is not None]), solves


def _around(stations: PlacedStations, best: PlacementOptimum, share: float, rng: np.random.Generator) -> Postures:
    """Placements about an optimum, for branches that the way there did not see."""
    W = stations.in_plane(stations.placement.near(best.w, share, _PLACEMENTS_PER_HOP, rng))
    return stations.best(W, _STARTS_PER_PLACEMENT, rng, best.found.Q)


def _shared(stations: PlacedStations, found: Postures, rng: np.random.Generator) -> Postures:
    """The same placements; where most of them fail, each tried with the postures of the best ones too.

    Where few random postures keep clear of what is around, what is possible at one placement mostly is nearby.
    """
    best = [m for m in np.argsort(found.loss, kind="stable")[:2] if np.isfinite(found.loss[m])]
    if not best or np.isfinite(found.loss).mean() > _SHARED_BELOW:
        return found
    failed = np.flatnonzero(~np.isfinite(found.loss))
    again = stations.better(found.rows(failed), stations.best(found.W[failed], 0, rng, found.Q[best]))
    order = np.argsort(np.concatenate([np.flatnonzero(np.isfinite(found.loss)), failed]))
    return found.rows(np.flatnonzero(np.isfinite(found.loss))).joined(again).rows(order)


def _nearer(stations: PlacedStations, found: Postures, share: float, rng: np.random.Generator) -> Postures:
    """More placements about those that fail least."""
    order = np.argsort(failing(found), kind="stable")[:4]
    W = np.vstack([stations.placement.near(found.W[m], share, 12, rng) for m in order])
    return found.joined(stations.best(stations.in_plane(W), _STARTS_PER_PLACEMENT, rng, found.Q[order]))


def failing(found: Postures) -> Array:
    """(M,) by how much placements fail: features without a posture count first, then by how much they miss it."""
    missing = found.gap > 0
    return np.asarray(missing.sum(axis=1) + np.minimum(found.gap, 1.0).sum(axis=1) / (1 + found.gap.shape[1]))


def _leading(stations: PlacedStations, found: Postures, most: int) -> list[int]:
    """The placements that lead the joint problem: the best ones, apart from each other; else those that fail least."""
    values = found.loss
    feasible = np.isfinite(values)
    order = np.argsort(values if feasible.any() else failing(found), kind="stable")
    size = np.where(stations.placement.free, stations.placement.upper - stations.placement.lower, 1.0)
    chosen: list[int] = []
    for m in order[: int(feasible.sum())] if feasible.any() else order:
        apart = [np.max(np.abs(found.W[m] - found.W[c]) / size) > _MIN_DISTANCE_SHARE for c in chosen]
        if all(apart) and np.isfinite(found.Q[m]).all():
            chosen.append(int(m))
        if len(chosen) == most:
            break
    return chosen


def _improved(
    stations: PlacedStations, start: Postures, end: StationsOutcome, rng: np.random.Generator
) -> tuple[PlacementOptimum | None, int]:
    """The optimum that a placement leads to, and how often the joint problem was solved for it.

    In turn each feature is solved again where the joint problem ended, and the joint problem from there.
    """
    best, value, optimal, solves = start, float(start.loss[0]), False, 0
    for _ in range(_MAX_ROUNDS):
        if not np.all(np.isfinite(end.point.Q)):
            break
        w = stations.placement.tidied(end.point.w)
        found = stations.best(w[None], _STARTS_AT_OPTIMUM, rng, end.point.Q[None])
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
    """The objective up to which an optimum counts as the same: of a probability its logarithm, else about one."""
    return best + _OBJECTIVE_TOLERANCE * max(1.0, abs(best))


def _distinct(stations: PlacedStations, optima: list[PlacementOptimum]) -> tuple[PlacementOptimum, ...]:
    """Optima that differ by more than 2 % of the box in a coordinate, best first, with how often each was found."""
    size = np.where(stations.placement.free, stations.placement.upper - stations.placement.lower, 1.0)
    kept: list[PlacementOptimum] = []
    least = min((optimum.objective for optimum in optima), default=0.0)
    tie = least + _ROUNDING_TOLERANCE * max(1.0, abs(least))
    centre = stations.placement.centre

    def rank(o: PlacementOptimum) -> tuple[float, float, tuple[float, ...]]:
        """Of mirrored placements that are as good, the one nearest to the centre, then that of larger coordinates."""
        away = round(float(np.linalg.norm((o.w - centre) / size)), 3)
        return max(o.objective, tie), away, tuple(-np.round(o.w, 3))

    for optimum in sorted(optima, key=rank):
        same = [i for i, o in enumerate(kept) if np.max(np.abs(o.w - optimum.w) / size) < 0.02]
        if same:
            kept[same[0]] = replace(kept[same[0]], count=kept[same[0]].count + optimum.count)
        else:
            kept.append(optimum)
    return tuple(kept)
