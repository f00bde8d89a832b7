"""``MapCandidate``: the best known posture of a target of a map; ``MapPoint``: what the task makes of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from posture_opt.numerics import Array, Json, finite_or_none
from posture_opt.selection.answer.end_moments import end_moments, success_with_peg
from posture_opt.selection.answer.solution import critical_basis
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.uncertainty.regions.clearance import within_clearance
from posture_opt.uncertainty.regions.coverage_radius import central_radii, coverage_radius
from posture_opt.uncertainty.spread.task_spread import sigma_along
from posture_opt.workers.record_pattern import FINITE, Either, Pattern, recorded

PackedRow = list[Any]
"""Numbers, texts and lists of them in an order that their class knows, as they travel between processes."""

MapStatus = Literal["feasible", "not reached", "requirement not met"]


@dataclass(frozen=True)
class MapCandidate:
    """What was found for one target of a map."""

    # feasible; not reached: no start arrived; requirement not met: some arrived, but collide or miss a term
    status: MapStatus
    best: CandidatePosture | None  # the best posture, None where there is none
    scale: float  # variance [m²] that its objective is divided by; NaN where no start arrived

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


@dataclass(frozen=True)
class NeighbourSolves:
    """What targets learnt from postures of their neighbours."""

    again: int  # targets with a posture that were solved again, because a neighbour's was another one or they stood out
    better: int  # those of them that became better by it
    most: float  # the largest share of σ that one gained
    found: int  # targets that had no posture before

    def to_json(self) -> dict[str, Json]:
        """The numbers as they are."""
        return {"again": self.again, "better": self.better, "most": self.most, "found": self.found}


@dataclass(frozen=True, eq=False)
class MapPoint:
    """One target with the best posture there; numbers are NaN where there is none."""

    position: Array  # (3,) the target [m], world
    status: MapStatus  # feasible, not reached, or requirement not met
    optimal: bool  # whether the solver confirmed the posture
    q: Array  # (n,) [rad or m]
    covariance: Array  # (3, 3) of the tool point [m²], world
    bias: Array  # (3,) mean minus nominal tool point [m]
    sigma_max: float  # largest standard deviation of the part of the spread that counts [m]
    sigma_along: float  # along the direction [m]
    radius95: float  # distance from the target that 95 % of all tool points stay within, in the part that counts [m]
    success_probability: float  # to stay within the clearance; NaN without one
    # where there is no posture that keeps clear, what the best of the others meets: an obstacle's name or self-
    # collision; else empty
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
    """``σ² = λ_max(Bᵀ C B)``, basis B (3, m); 95 % radii about the target, biased where the bias exceeds 1 % of σ."""
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
        if float(np.linalg.norm(b)) > 0.01 * sigma:  # a smaller shift moves the radius by 1e-4 of it
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
    nan = math.nan
    return MapPoint(target.lower, status, False, q, np.full((3, 3), nan), np.full(3, nan), nan, nan, nan, nan)
