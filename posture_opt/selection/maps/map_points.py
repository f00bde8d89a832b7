"""``Grid``: the targets of a map in a plane that a figure can show; ``MapPoint``: one of them with its best posture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import get_args

import numpy as np

from posture_opt.numerics import Array, Codes, Json, finite_or_none
from posture_opt.selection.answer.end_moments import end_moments, success_with_peg
from posture_opt.selection.answer.solution import critical_basis
from posture_opt.selection.maps.map_candidate import MapCandidate, MapStatus, PackedRow
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.uncertainty.regions.clearance import within_clearance
from posture_opt.uncertainty.regions.coverage_radius import central_radii, coverage_radius
from posture_opt.uncertainty.spread.task_spread import sigma_along
from posture_opt.workers.record_pattern import FINITE, Either, Pattern, recorded

ALIGNED = 1e-9  # off one, of the largest component of a unit vector along an axis: rounding


@dataclass(frozen=True, eq=False)
class Grid:
    """Targets ``origin + u e1 + v e2 + w e3``, u running fastest.

    Args:
        origin: (3,) [m], world.
        axes: (3, 3) unit vectors e1, e2, e3, one a row: the two that a figure shows, and the one across them.
        values: of u, v, w [m], ascending.
    """

    origin: Array
    axes: Array
    values: tuple[Array, Array, Array]

    @property
    def shape(self) -> tuple[int, int, int]:
        """How many values of w, v and u: the shape of an array over all targets."""
        u, v, w = map(len, self.values)
        return w, v, u

    @property
    def aligned(self) -> bool:
        """Whether u, v, w are coordinates of the world."""
        return not self.origin.any() and along_world_axes(self.axes)

    @cached_property
    def points(self) -> Array:
        """(N, 3) all targets in the world [m]."""
        w, v, u = np.meshgrid(*self.values[::-1], indexing="ij")
        return np.asarray(self.origin + np.stack([u, v, w], axis=-1).reshape(-1, 3) @ self.axes)

    def coordinates(self, points: Array) -> Array:
        """(N, 3) u, v, w of points in the world (N, 3) [m]."""
        return np.asarray((points - self.origin) @ self.axes.T)

    @cached_property
    def neighbours(self) -> tuple[tuple[Codes, Codes], ...]:
        """For every direction to one of the neighbours: the targets that have one there, and those neighbours."""
        index = np.arange(math.prod(self.shape)).reshape(self.shape)
        steps = [(0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 1, 1), (0, 1, -1)]
        pairs = []
        for step in steps:
            here = index[tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in zip(step, self.shape, strict=True))].ravel()
            there = index[
                tuple(slice(max(s, 0), n - max(-s, 0)) for s, n in zip(step, self.shape, strict=True))
            ].ravel()
            pairs += [(here, there), (there, here)] if len(here) else []
        return tuple(pairs)

    def cells(self, points: Array) -> Codes:
        """The target (N,) in whose cell each point (N, 3) [m] is, world; -1 outside of all cells.

        Across the figure's plane a cell is as thick as the distance of its layers; of a single layer, as its longer
        side.
        """
        at = self.coordinates(points)
        sides = self.sides
        index, inside = [], np.ones(len(points), dtype=bool)
        for k, values in enumerate(self.values):
            nearest = np.abs(at[:, k, None] - values).argmin(axis=1)
            inside &= np.abs(at[:, k] - values[nearest]) <= sides[k] / 2
            index.append(nearest)
        return np.where(inside, np.ravel_multi_index(tuple(index[::-1]), self.shape), -1)

    def to_json(self) -> dict[str, Json]:
        """Axes, origin [m] and values [m] of the grid, world."""
        return {
            "origin": self.origin.tolist(),
            "axes": self.axes.tolist(),
            "values": [values.tolist() for values in self.values],
            "order": "the first axis runs fastest",
        }

    @property
    def sides(self) -> tuple[float, float, float]:
        """Edges of a cell along u, v, w [m]; along an axis with one value, the longest of the others."""
        steps = [float(values[1] - values[0]) if len(values) > 1 else 0.0 for values in self.values]
        a, b, c = (step or max(steps) for step in steps)
        return a, b, c


def along_world_axes(axes: Array) -> bool:
    """Whether unit vectors (k, 3), one a row, all lie along axes of the world."""
    return bool(np.all(np.max(np.abs(axes), axis=1) > 1 - ALIGNED))


NEGLIGIBLE_BIAS = 0.01  # of σ: a smaller shift of the mean moves a radius by 1e-4 of it


@dataclass(frozen=True)
class NeighbourSolves:
    """What targets learnt from postures of their neighbours.

    Args:
        again: targets with a posture that were solved again, because a neighbour's was another one or they stood out.
        better: those of them that became better by it.
        most: the largest share of σ that one gained.
        found: targets that had no posture before.
    """

    again: int
    better: int
    most: float
    found: int

    def to_json(self) -> dict[str, Json]:
        """The numbers as they are."""
        return {"again": self.again, "better": self.better, "most": self.most, "found": self.found}


@dataclass(frozen=True, eq=False)
class MapPoint:
    """One target with the best posture there; numbers are NaN where there is none.

    Args:
        position: (3,) the target [m], world.
        status: ``feasible``, ``not reached``, or ``requirement not met``.
        optimal: whether the solver confirmed the posture.
        q: (n,) [rad or m].
        covariance: (3, 3) of the tool point [m²], world.
        bias: (3,) mean minus nominal tool point [m].
        sigma_max: largest standard deviation of the part of the spread that counts [m].
        sigma_along: along the direction [m].
        radius95: distance from the target that 95 % of all tool points stay within, in the part that counts [m].
        success_probability: to stay within the clearance; NaN without one.
        blocked_by: where there is no posture that keeps clear, what the best of the others meets: an obstacle's name or
            ``self-collision``; else empty.
    """

    position: Array
    status: MapStatus
    optimal: bool
    q: Array
    covariance: Array
    bias: Array
    sigma_max: float
    sigma_along: float
    radius95: float
    success_probability: float
    blocked_by: str = ""

    @property
    def feasible(self) -> bool:
        """Whether there is a posture."""
        return self.status == "feasible"

    def packed(self) -> PackedRow:
        """Numbers and text, to be sent."""
        numbers = (self.q, self.covariance.ravel(), self.bias)
        rest = (self.sigma_max, self.sigma_along, self.radius95, self.success_probability)
        return [self.status, self.optimal, *(array.tolist() for array in numbers), *map(float, rest)]

    @staticmethod
    def pattern(joints: int) -> Pattern:
        """That of `packed`, of an arm with so many joints; numbers are known where the target is feasible."""
        found = (frozenset(["feasible"]), bool, (FINITE,) * joints, (FINITE,) * 9, (FINITE,) * 3, *(float,) * 4)
        none = (frozenset(get_args(MapStatus)), bool, (float,) * joints, (float,) * 9, (float,) * 3, *(float,) * 4)
        return Either(found, (none[0] - {"feasible"}, *none[1:]))

    @classmethod
    def unpacked(cls, position: Array, row: PackedRow) -> MapPoint:
        """The one at ``position`` (3,) [m] that was packed."""
        status, optimal, q, covariance, bias, *rest = row
        return cls(position, status, optimal, np.array(q), np.reshape(covariance, (3, 3)), np.array(bias), *rest)

    def to_json(self, joints: tuple[str, ...]) -> dict[str, Json]:
        """SI units; what is not known is null."""
        return {
            "position": self.position.tolist(),
            "feasible": self.feasible,
            "status": "optimal" if self.optimal else "feasible" if self.feasible else "infeasible",
            "reason": "" if self.feasible else self.status,
            "blocked_by": self.blocked_by,
            "sigma_max": finite_or_none(self.sigma_max),
            "sigma_along": finite_or_none(self.sigma_along),
            "radius95": finite_or_none(self.radius95),
            "success_probability": finite_or_none(self.success_probability),
            "posture": dict(zip(joints, map(float, self.q), strict=True)) if self.feasible else None,
        }


@recorded(lambda engine, item: (MapPoint.pattern(engine.optimisation_problem.robot.n),) * len(item[0]))
def packed_points(engine: Engine, item: tuple[Sequence[TaskTarget], Sequence[MapCandidate]]) -> list[PackedRow]:
    """Targets with what was found there, as packed points: a part of the work."""
    return [map_point.packed() for map_point in map_points_of(engine.optimisation_problem, *item)]


def map_points_of(
    problem: OptimisationProblem, targets: Sequence[TaskTarget], candidates: Sequence[MapCandidate]
) -> list[MapPoint]:
    """Moments of all postures in one evaluation, and what the task makes of them.

    ``σ² = λ_max(Bᵀ C B)`` with the basis B (3, m) of the part that counts; the 95 % radius is about the target, with
    the bias where it exceeds 1 % of σ.

    Args:
        targets: N points; ``candidates`` what was found at each.
    """
    B, d = critical_basis(problem, targets[0]), targets[0].direction
    found = [k for k, candidate in enumerate(candidates) if candidate.best is not None]
    nothing = np.full(problem.robot.n, np.nan)
    postures = {k: best.q for k, candidate in enumerate(candidates) if (best := candidate.best) is not None}
    if not found:
        return [
            _empty(target, candidate.status, nothing) for target, candidate in zip(targets, candidates, strict=True)
        ]
    Q = np.array([postures[k] for k in found])
    moments = end_moments(problem, Q, B, targets[0].lever)  # that of the task, wherever it is done
    C, bias = moments.covariance, moments.bias
    own = B.T @ C @ B
    row, central = {k: i for i, k in enumerate(found)}, central_radii(0.95, own)
    map_points = []
    for k, (target, candidate) in enumerate(zip(targets, candidates, strict=True)):
        if candidate.best is None:
            map_points.append(_empty(target, candidate.status, nothing))
            continue
        i = row[k]
        b, sigma = B.T @ bias[i], float(moments.sigma[i])
        radius = float(central[i])
        if float(np.linalg.norm(b)) > NEGLIGIBLE_BIAS * sigma:
            radius = coverage_radius(0.95, own[i], b)
        hit = success_with_peg(problem, Q[i], B, target)
        hit = within_clearance(own[i], target.clearance, b) if hit is None else hit
        along = sigma_along(d, C[i])
        map_points.append(
            MapPoint(target.lower, "feasible", candidate.best.optimal, Q[i], C[i], bias[i], sigma, along, radius,
                     math.nan if hit is None else hit)
        )  # fmt: skip
    return map_points


def _empty(target: TaskTarget, status: MapStatus, q: Array) -> MapPoint:
    """The point of a target without a posture: NaN in place of numbers."""
    nan = math.nan
    return MapPoint(target.lower, status, False, q, np.full((3, 3), nan), np.full(3, nan), nan, nan, nan, nan)
