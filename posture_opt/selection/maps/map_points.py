"""``MapCandidate``: the best known posture of a target of a map; ``MapPoint``: what the task makes of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from posture_opt.encoding import Encoded
from posture_opt.numerics import Array, Json, finite_or_none
from posture_opt.selection.answer.other_postures import end_moments, success_with_peg
from posture_opt.selection.answer.target_answer import critical_basis
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.uncertainty.clearance import central_radii, coverage_radius, within_clearance
from posture_opt.uncertainty.task_spread import sigma_along
from posture_opt.workers.record_pattern import FINITE, Either, Pattern, recorded

PackedRow = list[Any]
"""Numbers, texts and lists of them in an order that their class knows, as they travel between processes."""

MapStatus = Literal["feasible", "not reached", "requirement not met"]


@dataclass(frozen=True)
class MapCandidate:
    """What was found for one target of a map."""

    status: MapStatus  # not reached: no start arrived; requirement not met: some arrived, but collide or miss a term
    best: CandidatePosture | None  # the best posture, None where there is none
    scale: float  # variance [m²] that its objective is divided by; NaN where no start arrived

    def packed(self) -> PackedRow:
        c = self.best
        if c is None:
            return [self.status, self.scale]
        numbers = (float(c.objective), float(c.violation), float(c.sigma))
        return [self.status, float(self.scale), c.q.tolist(), *numbers, bool(c.optimal), c.message, int(c.count)]

    @staticmethod
    def pattern(joints: int) -> Pattern:
        found = (frozenset(["feasible"]), float, (FINITE,) * joints, *(float,) * 3, bool, str, int)
        return Either(found, (frozenset(get_args(MapStatus)) - {"feasible"}, float))

    @classmethod
    def unpacked(cls, row: PackedRow) -> MapCandidate:
        status, scale, *best = row
        return cls(status, CandidatePosture(np.array(best[0]), *best[1:]) if best else None, scale)


@dataclass(frozen=True)
class NeighbourSolves(Encoded):
    """What targets learnt from their neighbours."""

    again: int  # targets with a posture that were solved again, because a neighbour's was another one or they stood out
    better: int  # those of them that became better by it
    most: float  # the largest share of σ that one gained
    found: int  # targets that had no posture before


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
    blocked_by: str = ""  # the obstacle, or self-collision, that the best posture meets where none keeps clear

    @property
    def feasible(self) -> bool:
        return self.status == "feasible"

    def packed(self) -> PackedRow:
        numbers = (self.q, self.covariance.ravel(), self.bias)
        rest = (self.sigma_max, self.sigma_along, self.radius95, self.success_probability)
        return [self.status, self.optimal, *(array.tolist() for array in numbers), *map(float, rest)]

    @staticmethod
    def pattern(joints: int) -> Pattern:
        found, others = frozenset(["feasible"]), frozenset(get_args(MapStatus)) - {"feasible"}
        known, nan = ([(number,) * size for size in (joints, 9, 3)] for number in (FINITE, float))
        return Either((found, bool, *known, *(float,) * 4), (others, bool, *nan, *(float,) * 4))

    @classmethod
    def unpacked(cls, position: Array, row: PackedRow) -> MapPoint:
        status, optimal, q, covariance, bias, *rest = row
        return cls(position, status, optimal, np.array(q), np.reshape(covariance, (3, 3)), np.array(bias), *rest)

    def to_json(self, joints: tuple[str, ...]) -> dict[str, Json]:
        """SI units; unknown numbers are null."""
        numbers = ("sigma_max", "sigma_along", "radius95", "success_probability")
        return {
            "position": self.position.tolist(),
            "feasible": self.feasible,
            "status": "optimal" if self.optimal else "feasible" if self.feasible else "infeasible",
            "reason": "" if self.feasible else self.status,
            "blocked_by": self.blocked_by,
            **{name: finite_or_none(getattr(self, name)) for name in numbers},
            "posture": dict(zip(joints, map(float, self.q), strict=True)) if self.feasible else None,
        }


@recorded(lambda engine, items: (MapPoint.pattern(engine.optimisation_problem.robot.n),) * len(items))
def packed_points(engine: Engine, items: Sequence[tuple[TaskTarget, MapCandidate]]) -> list[PackedRow]:
    """Packed points: ``σ² = λ_max(Bᵀ C B)``, basis B (3, m) of the part that counts, all moments in one evaluation.

    The 95 % radius is about the target, with the bias where it exceeds 1 % of σ: less moves it by 1e-4 of itself.
    """
    problem, first = engine.optimisation_problem, items[0][0]
    B = critical_basis(problem, first)
    found = {k: c.best.q for k, (_, c) in enumerate(items) if c.best is not None}
    if not found:
        return [_empty(problem, target, c.status).packed() for target, c in items]
    Q = np.array(list(found.values()))
    moments = end_moments(problem, Q, B, first.lever)  # the lever is that of the task, wherever it is done
    C, own = moments.covariance, B.T @ moments.covariance @ B
    central, row = central_radii(0.95, own), dict(zip(found, range(len(found)), strict=True))
    points = []
    for k, (target, candidate) in enumerate(items):
        if candidate.best is None:
            points.append(_empty(problem, target, candidate.status))
            continue
        i = row[k]
        bias, sigma = moments.bias[i], float(moments.sigma[i])
        b, radius = B.T @ bias, float(central[i])
        if float(np.linalg.norm(b)) > 0.01 * sigma:
            radius = coverage_radius(0.95, own[i], b)
        hit = success_with_peg(problem, Q[i], B, target)
        hit = within_clearance(own[i], target.clearance, b) if hit is None else hit
        p = math.nan if hit is None else hit
        along = sigma_along(first.direction, C[i])
        best = candidate.best
        points.append(MapPoint(target.lower, "feasible", best.optimal, Q[i], C[i], bias, sigma, along, radius, p))
    return [point.packed() for point in points]


def _empty(problem: OptimisationProblem, target: TaskTarget, status: MapStatus) -> MapPoint:
    nan, q = math.nan, np.full(problem.robot.n, math.nan)
    return MapPoint(target.lower, status, False, q, np.full((3, 3), nan), np.full(3, nan), nan, nan, nan, nan)
