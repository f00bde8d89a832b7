"""The task planned twice, with the arm as it was believed to be and as measurements know it: what that changes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from posture_opt.errors import InputError, NoSolutionError, SolverError
from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array
from posture_opt.problem.problem import Problem
from posture_opt.selection.selector import select_posture
from posture_opt.selection.solution import Solution
from posture_opt.uncertainty.ball import radius_in_space
from posture_opt.uncertainty.clearance import radius_for, success_probability
from posture_opt.uncertainty.spread import propagate


@dataclass(frozen=True, eq=False)
class Landing:
    """Where the tool point comes to lie in one posture, by what the measurements say of the arm.

    Args:
        miss: (3,) mean tool point minus the target, world [m].
        across: (m,) the part of it that the task cares about [m].
        sigma_max: largest standard deviation of that part [m].
        critical_error: distance from the target that 95 of 100 visits stay within, in that part [m].
        success_probability: of staying within the clearance; None without one.
    """

    miss: Array
    across: Array
    sigma_max: float
    critical_error: float
    success_probability: float | None

    @property
    def distance(self) -> float:
        """How far the mean lies off the target in the part that counts [m]."""
        return float(np.linalg.norm(self.across))


@dataclass(frozen=True, eq=False)
class Replanned:
    """The best posture of the arm as it was believed to be, and of the arm as it is known now.

    Args:
        before, after: the two answers; None where there is none.
        landed: where the arm comes to lie in the first posture; the second one is corrected for.
        landing: the same of the second posture.
        reasons: why there is no answer, in sentences.
    """

    before: Solution | None = None
    after: Solution | None = None
    landed: Landing | None = None
    landing: Landing | None = None
    reasons: tuple[str, ...] = ()

    def to_json(self, after: str = "calibrated") -> dict[str, Any]:
        """The part ``posture`` of a document: both postures, and what is to be expected of each [m, rad]."""
        return {
            "nominal": _json(self.before, self.landed),
            after: _json(self.after, self.landing),
            "reasons": list(self.reasons),
        }


def replan(old: Problem, new: Problem, *, seed: int | None = None, workers: int = 1) -> Replanned | None:
    """The task of ``old`` planned with both arms, the first posture judged by the second; None without a task.

    Where the old problem states no scatter, that of the new one is taken for it. Where the new arm has no posture for
    the task, the old one is not asked.
    """
    if old.task is None or new.task is None:
        return None
    if old.sources.empty:
        old = replace(old, sources=new.sources)
    after, reasons = _planned(new, seed, workers)
    if after is None:  # the search for reasons is long, and the old arm would have the same
        return Replanned(reasons=reasons)
    before, reasons = _planned(old, seed, workers)
    landed = None if before is None else _landing(new, before, after.basis)
    return Replanned(before, after, landed, _landing(new, after, after.basis), reasons)


def replan_with(
    olds: Mapping[str, Problem], new: Problem, *, seed: int | None = None
) -> dict[str, Replanned]:  # fmt: skip
    """The task planned with each of several arms, every posture judged by the arm of ``new``."""
    after, reasons = _planned(new, seed, 1)
    if after is None:
        return {name: Replanned(reasons=reasons) for name in olds}
    landing = _landing(new, after, after.basis)
    found = {}
    for name, old in olds.items():
        old = replace(old, sources=new.sources) if old.sources.empty and old.robot.extension is None else old
        before, reasons = _planned(old, seed, 1)
        landed = None if before is None else _landing(new, before, after.basis)
        found[name] = Replanned(before, after, landed, landing, reasons)
    return found


def _planned(problem: Problem, seed: int | None, workers: int) -> tuple[Solution | None, tuple[str, ...]]:
    if far := _far_away(problem):
        return None, (far,)
    try:
        return select_posture(problem, seed=seed, workers=workers), ()
    except (NoSolutionError, InputError, SolverError) as error:
        return None, tuple(str(error).splitlines())


def _far_away(problem: Problem) -> str:
    """Why the target is out of reach of any arm of this length, or an empty text; a search would take much longer."""
    robot, task = problem.robot, problem.task
    assert task is not None
    if task.position is None:
        return ""
    first = robot.driven[0]
    reached = walk(robot.factors, factor_values(robot.factors, [0.0] * robot.n))
    distance = float(np.linalg.norm(np.array(task.position) - np.array(reached.screws[first].origin, dtype=float)))
    stretched = sum(abs(factor.nominal) for factor in robot.factors[first:] if factor.kind == "translate")
    stretched += sum(max(abs(j.lower), abs(j.upper)) for j in robot.joints if j.type == "prismatic")
    if distance <= stretched:
        return ""
    return (
        f"the target is out of reach: {distance:.2f} m from the first joint, and the arm stretches to {stretched:.2f} m"
    )


def _landing(problem: Problem, solution: Solution, basis: Array) -> Landing:
    """By the arm of ``problem``, at the posture of a solution that another arm may have been asked for."""
    spread = propagate(problem, solution.q)
    wanted = np.clip(solution.spread.position, solution.goal.lower, solution.goal.upper)
    miss = spread.position + spread.bias - wanted
    across, C = basis.T @ miss, basis.T @ spread.covariance @ basis
    clearance = solution.goal.clearance
    hit = None if math.isnan(clearance) or len(C) > 2 else success_probability(C, clearance, across)
    return Landing(
        miss=miss,
        across=across,
        sigma_max=math.sqrt(max(float(np.linalg.eigvalsh(C)[-1]), 0.0)),
        critical_error=radius_for(0.95, C, across) if len(C) < 3 else radius_in_space(0.95, C, across),
        success_probability=hit,
    )


def _json(solution: Solution | None, landing: Landing | None) -> dict[str, Any] | None:
    if solution is None or landing is None:
        return None
    return {
        "posture": solution.posture,
        "predicted_sigma_max": solution.critical.sigma_max,
        "sigma_max": landing.sigma_max,
        "miss": landing.miss.tolist(),
        "critical_error": landing.critical_error,
        "success_probability": landing.success_probability,
    }
