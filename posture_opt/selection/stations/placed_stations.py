"""``PlacedStations``: the features of a workpiece; the best posture of each at many placements, independently.

Once the placement is given, no feature depends on the others: the best postures there are those of single problems.
So placements are compared by solving all features at all of them in batches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.numerics import Array, Codes, DerivedAgain
from posture_opt.selection.answer.combine import combined_numbers
from posture_opt.selection.answer.placement import PlacementRange
from posture_opt.selection.program.pose_request import PARTS, PoseRequest
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import STEPS, Engine
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE, TOLERANCE
from posture_opt.selection.search.inverse_kinematics import STEPS as IK_STEPS
from posture_opt.selection.stations.stations_problem import Station, StationsProblem
from posture_opt.selection.tasks.workpiece import Combine

_COLUMNS = ("W", "Q", "main", "extra", "sigma", "gap")
_STARTS_PER_SEARCH = (
    8  # one in so many of a feature's random postures is improved, two at the least, the promising ones
)


@dataclass(frozen=True)
class Postures:
    """The best posture found of each of K stations at each of M placements.

    Args:
        W: (M, 4) placements.
        Q: (M, K, n) postures, NaN where nothing was found.
        main: (M, K) first term of the objective, infinite where no posture is feasible; extra: (M, K) further terms.
        sigma: (M, K) largest standard deviation of the part that counts [m].
        gap: (M, K) zero where a posture is feasible; else the least error of the inverse kinematics or of a row.
        tried: random postures that were led to targets.
    """

    W: Array
    Q: Array
    main: Array
    extra: Array
    sigma: Array
    gap: Array
    tried: int = 0

    def rows(self, chosen: Codes) -> Postures:
        """The placements of the ``chosen`` rows, in this order."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in _COLUMNS})

    def better_of(self, other: Postures) -> Postures:
        """Station by station the better posture of two searches at the same placements."""
        mine, theirs = self.main + self.extra, other.main + other.extra
        take = (other.gap < self.gap) | ((other.gap == self.gap) & (theirs < mine))
        best = {
            name: np.where(take, getattr(other, name), getattr(self, name))
            for name in ("main", "extra", "sigma", "gap")
        }
        Q = np.where(take[..., None], other.Q, self.Q)
        return replace(self, Q=Q, **best, tried=self.tried + other.tried)

    def joined(self, other: Postures) -> Postures:
        """The placements of both, in this order."""
        both = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS}
        return replace(self, **both, tried=self.tried + other.tried)


@dataclass(frozen=True)
class PlacedStations(DerivedAgain):
    """K stations on one workpiece.

    Args:
        engines: of each station; those of one kind share one.
        targets: in the frame of the workpiece, with one scale.
        placement: where the workpiece may stand.
    """

    engines: tuple[Engine, ...] = field(repr=False)
    targets: tuple[TaskTarget, ...]
    placement: PlacementRange
    combine: Combine

    def __reduce__(self) -> tuple[Any, ...]:
        return PlacedStations, (self.engines, self.targets, self.placement, self.combine)

    @cached_property
    def joint(self) -> StationsProblem:
        """All stations and the placement as one nonlinear program."""
        pairs = zip(self.engines, self.targets, strict=True)
        stations = tuple(Station(engine.optimisation_problem, target) for engine, target in pairs)
        box = self.placement.without_seam
        return StationsProblem(stations, box.lower, box.upper, self.combine)

    def scaled(self, scale: float) -> PlacedStations:
        """The same stations with the objectives divided by another variance [m²]."""
        targets = tuple(replace(target, scale=scale) for target in self.targets)
        return PlacedStations(self.engines, targets, self.placement, self.combine)

    def scale_of(self, found: Postures) -> float:
        """What the objectives are divided by [m²]: the median over all feasible postures; one where there is none."""
        own = found.main[np.isfinite(found.main)]
        return self.engines[0].scale_of(own * self.targets[0].scale) if len(own) else 1.0

    def combined(self, found: Postures) -> Array:
        """(M,) the objective of all stations together at each placement, as the joint problem has it."""
        return combined_numbers(self.combine, found.main, found.extra)

    def at(self, w: Array) -> list[TaskTarget]:
        """The targets of all stations at a placement w (4,) [m, rad], world."""
        return [target.moved(w) for target in self.targets]

    def in_plane(self, W: Array) -> Array:
        """Placements W (M, 4), those of a planar arm shifted within the box so that the first target is in reach."""
        reach = self.engines[0].optimisation_problem.reach
        if not reach.normals.shape[1]:
            return W
        points = [self.targets[0].moved(w).lower for w in W]
        shifts = np.array([np.append(reach.outside(point, point), 0.0) for point in points])
        return np.asarray(np.clip(W + shifts, self.placement.lower, self.placement.upper))

    def best(self, W: Array, starts: int, rng: np.random.Generator, known: Array | None = None) -> Postures:
        """The best postures at placements W (M, 4), from random starts and from ``known`` postures (J, K, n)."""
        columns = []
        for k, (engine, target) in enumerate(zip(self.engines, self.targets, strict=True)):
            own = np.zeros((0, engine.robot.n)) if known is None else known[:, k]
            targets = [target.moved(w) for w in W]
            columns.append(_best_of_station(engine, targets, starts, own[np.isfinite(own).all(axis=1)], rng))
        Q, main, extra, sigma, gap = (np.stack(parts, axis=1) for parts in zip(*columns, strict=True))
        return Postures(W, Q, main, extra, sigma, gap, starts * len(W) * len(self.targets))


def _best_of_station(
    engine: Engine, targets: Sequence[TaskTarget], starts: int, known: Array, rng: np.random.Generator
) -> tuple[Array, Array, Array, Array, Array]:
    """Of one station at M targets: posture (M, n), and first term, further terms, σ, gap (M,) each."""
    count, M = starts + len(known), len(targets)
    drawn = engine.ik.random_postures(starts * M, rng).reshape(M, starts, engine.robot.n)
    begun = np.concatenate([drawn, np.broadcast_to(known, (M, *known.shape))], axis=1)
    requests = np.vstack([np.broadcast_to(engine.request(t, count, rng).rows, (count, PARTS[-1])) for t in targets])
    weights = engine.request(targets[0], 1, rng).weights
    position, axis, spin, _, slack, cone = np.split(requests, PARTS[1:-1], axis=1)
    request = PoseRequest(position, axis, spin, weights, slack, cone)
    Q, error = engine.ik.solve(begun.reshape(M * count, -1), request, steps=IK_STEPS)
    of = np.repeat(np.arange(M), count)
    gap = np.array([error[of == m].min() for m in range(M)])
    off = off_plane(engine, targets)
    rows = _promising(engine, targets, Q, of, (error < TOLERANCE) & (off[of] == 0), max(2, count // _STARTS_PER_SEARCH))
    main, extra, sigma, best = np.full(M, np.inf), np.zeros(M), np.full(M, np.inf), np.full((M, engine.robot.n), np.nan)
    if len(rows):
        optima = engine.descended_each(Q[rows], targets, of[rows], STEPS)
        values = _values(engine, targets, optima.q, of[rows])
        order = np.lexsort((values[:, 0], optima.excess))[::-1]  # the best one is written last
        for r in order:
            m = of[rows[r]]
            met = optima.excess[r] == 0
            gap[m], best[m] = (0.0 if met else optima.excess[r]), optima.q[r]
            main[m], extra[m] = (values[r, 1], values[r, 0] - values[r, 1]) if met else (np.inf, 0.0)
            sigma[m] = values[r, 3]
    return best, main, extra, sigma, np.maximum(gap, off)


def off_plane(engine: Engine, targets: Sequence[TaskTarget]) -> Array:
    """(M,) how far targets lie outside of the plane, or line, that the tool point cannot leave [m]; mostly zero."""
    reach = engine.optimisation_problem.reach
    if not reach.normals.shape[1]:
        return np.zeros(len(targets))
    shifts = [reach.outside(t.lower, t.upper) if reach.misses(t.lower, t.upper) else np.zeros(3) for t in targets]
    return np.asarray(np.linalg.norm(shifts, axis=1))


def _promising(engine: Engine, targets: Sequence[TaskTarget], Q: Array, of: Codes, arrived: Array, most: int) -> Codes:
    """The rows to be improved: of each target those that violate least, and of these the best ones."""
    rows = np.flatnonzero(arrived)
    if not len(rows):
        return rows
    objective, violation = _values(engine, targets, Q[rows], of[rows])[:, [0, 2]].T
    excess = np.where(violation <= ROW_TOLERANCE, 0.0, violation)
    order = np.lexsort((objective, excess, of[rows]))
    sorted_of = of[rows][order]
    rank = np.arange(len(order)) - np.searchsorted(sorted_of, sorted_of)
    return np.asarray(rows[order[rank < most]])


def _values(engine: Engine, targets: Sequence[TaskTarget], Q: Array, of: Codes) -> Array:
    """(N, 4) objective, first term, worst violation of a row, and σ [m], of each posture at its target."""
    parameters = np.array([target.parameters for target in targets])[of]
    objective, violation, main, variance = (column[:, 0] for column in engine.screen(Q, parameters))
    return np.column_stack([objective, main, violation, np.sqrt(np.maximum(variance, 0.0))])
