"""``MapPoint``: one target of a map with the best posture there, and what the task makes of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.selection.goal import Goal
from posture_opt.selection.map_candidates import Fate, Place
from posture_opt.selection.optimisation_problem import OptimisationProblem
from posture_opt.selection.solution import critical_basis
from posture_opt.uncertainty.ball import central_radii, radius_in_space
from posture_opt.uncertainty.clearance import radius_for, success_probability
from posture_opt.uncertainty.validity import finite_or_none

Floats = np.ndarray
_CENTRAL = 0.01  # of σ: a smaller shift of the mean moves a radius by 1e-4 of it


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

    position: Floats
    fate: Fate
    optimal: bool
    q: Floats
    covariance: Floats
    bias: Floats
    sigma_max: float
    sigma_along: float
    radius95: float
    success_probability: float

    @property
    def feasible(self) -> bool:
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


def spots_of(programme: OptimisationProblem, goals: Sequence[Goal], places: Sequence[Place]) -> list[MapPoint]:
    """Moments of all postures in one evaluation, and what the task makes of them."""
    B, d = critical_basis(programme, goals[0]), goals[0].direction
    found = [k for k, place in enumerate(places) if place.best is not None]
    nothing = np.full(programme.robot.n, np.nan)
    postures = {k: best.q for k, place in enumerate(places) if (best := place.best) is not None}
    if not found:
        return [_empty(goal, place.fate, nothing) for goal, place in zip(goals, places, strict=True)]
    Q = np.array([postures[k] for k in found])
    moments = programme.tool_point.moments([np.ascontiguousarray(column) for column in Q.T])
    C = np.broadcast_to(moments.covariance, (len(Q), 3, 3))
    bias = np.broadcast_to(moments.mean - moments.position, (len(Q), 3))
    own = B.T @ C @ B
    row, central = {k: i for i, k in enumerate(found)}, central_radii(0.95, own)
    spots = []
    for k, (goal, place) in enumerate(zip(goals, places, strict=True)):
        if place.best is None:
            spots.append(_empty(goal, place.fate, nothing))
            continue
        i = row[k]
        b, sigma = B.T @ bias[i], math.sqrt(max(float(np.linalg.eigvalsh(own[i])[-1]), 0.0))
        radius = float(central[i])
        if float(np.linalg.norm(b)) > _CENTRAL * sigma:
            radius = radius_for(0.95, own[i], b) if len(b) < 3 else radius_in_space(0.95, own[i], b)
        hit = math.nan
        if not math.isnan(goal.clearance) and len(b) < 3:
            hit = success_probability(own[i], goal.clearance, b)
        along = math.sqrt(max(float(d @ C[i] @ d), 0.0))
        spots.append(
            MapPoint(goal.lower, "feasible", place.best.optimal, Q[i], C[i], bias[i], sigma, along, radius, hit)
        )  # fmt: skip
    return spots


def _empty(goal: Goal, fate: Fate, q: Floats) -> MapPoint:
    nan = math.nan
    return MapPoint(goal.lower, fate, False, q, np.full((3, 3), nan), np.full(3, nan), nan, nan, nan, nan)
