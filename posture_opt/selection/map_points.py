"""``MapPoint``: one target of a map with the best posture there, and what the task makes of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from posture_opt.numerics import Array, finite_or_none
from posture_opt.selection.engine import CandidatePosture
from posture_opt.selection.optimisation_problem import OptimisationProblem
from posture_opt.selection.solution import critical_basis
from posture_opt.selection.task_target import TaskTarget
from posture_opt.uncertainty.clearance import within_clearance
from posture_opt.uncertainty.coverage_radius import central_radii, coverage_radius

Fate = Literal["feasible", "not reached", "requirement not met"]

_CENTRAL = 0.01  # of σ: a smaller shift of the mean moves a radius by 1e-4 of it


@dataclass(frozen=True)
class MapCandidate:
    """What was found for one target: a posture, or why there is none."""

    fate: Fate
    best: CandidatePosture | None
    scale: float


@dataclass(frozen=True, eq=False)
class MapPoint:
    """One target with the best posture there; numbers are NaN where there is none.

    Args:
        position: (3,) the target [m], world.
        fate: ``feasible``, ``not reached``, or ``requirement not met``.
        optimal: whether the solver confirmed the posture.
        q: (n,) [rad or m].
        covariance: (3, 3) of the tool point [m²], world.
        bias: (3,) mean minus nominal tool point [m].
        sigma_max: largest standard deviation of the part of the spread that counts [m].
        sigma_along: along the direction [m].
        radius95: distance from the target that 95 % of all tool points stay within, in the part that counts [m].
        success_probability: to stay within the clearance; NaN without one.
    """

    position: Array
    fate: Fate
    optimal: bool
    q: Array
    covariance: Array
    bias: Array
    sigma_max: float
    sigma_along: float
    radius95: float
    success_probability: float

    @property
    def feasible(self) -> bool:
        """Whether there is a posture."""
        return self.fate == "feasible"

    def to_json(self, joints: tuple[str, ...]) -> dict[str, Any]:
        """SI units; what is not known is null."""
        return {
            "position": self.position.tolist(),
            "feasible": self.feasible,
            "status": "optimal" if self.optimal else "feasible" if self.feasible else "infeasible",
            "reason": "" if self.feasible else self.fate,
            "sigma_max": finite_or_none(self.sigma_max),
            "sigma_along": finite_or_none(self.sigma_along),
            "radius95": finite_or_none(self.radius95),
            "success_probability": finite_or_none(self.success_probability),
            "posture": dict(zip(joints, map(float, self.q), strict=True)) if self.feasible else None,
        }


def map_points_of(
    problem: OptimisationProblem, targets: Sequence[TaskTarget], candidates: Sequence[MapCandidate]
) -> list[MapPoint]:
    """Moments of all postures in one evaluation, and what the task makes of them."""
    B, d = critical_basis(problem, targets[0]), targets[0].direction
    found = [k for k, candidate in enumerate(candidates) if candidate.best is not None]
    nothing = np.full(problem.robot.n, np.nan)
    postures = {k: best.q for k, candidate in enumerate(candidates) if (best := candidate.best) is not None}
    if not found:
        return [_empty(target, candidate.fate, nothing) for target, candidate in zip(targets, candidates, strict=True)]
    Q = np.array([postures[k] for k in found])
    moments = problem.tool_point.moments([np.ascontiguousarray(column) for column in Q.T])
    C = np.broadcast_to(moments.covariance, (len(Q), 3, 3))
    bias = np.broadcast_to(moments.mean - moments.position, (len(Q), 3))
    own = B.T @ C @ B
    row, central = {k: i for i, k in enumerate(found)}, central_radii(0.95, own)
    map_points = []
    for k, (target, candidate) in enumerate(zip(targets, candidates, strict=True)):
        if candidate.best is None:
            map_points.append(_empty(target, candidate.fate, nothing))
            continue
        i = row[k]
        b, sigma = B.T @ bias[i], math.sqrt(max(float(np.linalg.eigvalsh(own[i])[-1]), 0.0))
        radius = float(central[i])
        if float(np.linalg.norm(b)) > _CENTRAL * sigma:
            radius = coverage_radius(0.95, own[i], b)
        hit = within_clearance(own[i], target.clearance, b)
        along = math.sqrt(max(float(d @ C[i] @ d), 0.0))
        map_points.append(
            MapPoint(target.lower, "feasible", candidate.best.optimal, Q[i], C[i], bias[i], sigma, along, radius,
                     math.nan if hit is None else hit)
        )  # fmt: skip
    return map_points


def _empty(target: TaskTarget, fate: Fate, q: Array) -> MapPoint:
    nan = math.nan
    return MapPoint(target.lower, fate, False, q, np.full((3, 3), nan), np.full(3, nan), nan, nan, nan, nan)
