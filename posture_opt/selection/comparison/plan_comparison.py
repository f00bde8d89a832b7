"""Comparison of named models of one arm: what each chooses for the task, and where a reference model sees it land."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.errors import InputError, Issue, NoSolutionError, SolverError
from posture_opt.interrupts import interruptible
from posture_opt.model.stretched import stretched
from posture_opt.numerics import Array, Json
from posture_opt.result import Result
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.comparison.posture_distance import PostureDistance
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.select_posture import at_one_feature, planned_posture
from posture_opt.uncertainty.regions.clearance import within_clearance
from posture_opt.uncertainty.regions.coverage_radius import coverage_radius
from posture_opt.uncertainty.regions.regions import deviation
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.spread.spread import propagate
from posture_opt.uncertainty.spread.spread_parts import SpreadParts, spread_parts


@dataclass(frozen=True, eq=False)
class PredictedError:
    """Where the tool point lands in one posture, as the reference model predicts it.

    Args:
        miss: (3,) mean tool point minus the target [m], world.
        across: (m,) its components that the task cares about [m].
        sigma_max: largest standard deviation of these components [m].
        critical_error: distance from the target that 95 of 100 repeats stay within, in these components [m].
        success_probability: of staying within the clearance; None without one.
        covariance: (3, 3) of the tool point [m²], world.
        parts: what of it is scatter and what is systematic, in the components that count.
        from_measured: distance from the postures that the reference was learned from; None where nobody says which.
    """

    miss: Array
    across: Array
    sigma_max: float
    critical_error: float
    success_probability: float | None
    covariance: Array
    parts: SpreadParts | None = None
    from_measured: PostureDistance | None = None

    @property
    def distance(self) -> float:
        """Distance of the mean from the target in the components that count [m]."""
        return float(np.linalg.norm(self.across))


@dataclass(frozen=True, eq=False)
class PlannedPosture:
    """The best posture of one model: the answer and where it lands, or the reasons why there is none."""

    solution: Solution | None = None
    predicted_error: PredictedError | None = None
    reasons: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Json] | None:
        """The posture, the σ that the model predicts, and what the reference predicts [m, rad]; None without one."""
        if self.solution is None or self.predicted_error is None:
            return None
        parts, distance = self.predicted_error.parts, self.predicted_error.from_measured
        return {
            "posture": self.solution.posture,
            "predicted_sigma_max": self.solution.critical.sigma_max,
            "sigma_max": self.predicted_error.sigma_max,
            "miss": self.predicted_error.miss.tolist(),
            "critical_error": self.predicted_error.critical_error,
            "success_probability": self.predicted_error.success_probability,
            **({} if parts is None else {"spread": parts.to_json()}),
            **({} if distance is None else {"from_measured": distance.to_json()}),
        }


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """One task planned with several models of an arm, every posture judged by the last of them, the reference.

    Args:
        plans: what each model chooses, by its name.
        problem: the reference.
    """

    plans: Mapping[str, PlannedPosture]
    problem: ProblemData

    @property
    def reference(self) -> str:
        """The name of the model that judges."""
        return next(reversed(list(self.plans)))

    @property
    def answered(self) -> dict[str, tuple[Solution, PredictedError]]:
        """The models that have a posture, with where it lands."""
        return {
            name: (plan.solution, plan.predicted_error)
            for name, plan in self.plans.items()
            if plan.solution is not None and plan.predicted_error is not None
        }

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why models have no posture, in sentences, each once."""
        return tuple(dict.fromkeys(reason for plan in self.plans.values() for reason in plan.reasons))

    def to_json(self) -> dict[str, Json]:
        """The part ``posture`` of a document: what each model chooses and what the reference expects of it [m, rad]."""
        return {**{name: plan.to_json() for name, plan in self.plans.items()}, "reasons": list(self.reasons)}


@interruptible()
def compare_plans(
    models: Mapping[str, ProblemData], *, seed: int | None = None, workers: int = 1, hint: str = "",
    measured: Array | None = None,
) -> Comparison | None:  # fmt: skip
    """The task planned with each model, every posture judged by the last of them; None without a task.

    Of a task with features, the one that scatters most by the reference is planned, where the reference places it. A
    model that states no scatter takes that of the reference. Where the reference has no posture for the task, the
    others are not asked: the search for reasons is long, and theirs would be the same.

    Args:
        models: by name, the reference last.
        hint: told beside the reasons where a model has no posture.
        measured: (N, n) postures that the reference was learned from [rad or m].
    """
    *others, reference = models
    if any(model.task is None for model in models.values()):
        return None
    try:
        models = at_one_feature(models, models[reference], seed=seed, workers=workers)
    except (NoSolutionError, InputError, SolverError) as error:
        failed = PlannedPosture(reasons=tuple(str(error).splitlines()))
        return Comparison({**dict.fromkeys(others, PlannedPosture()), reference: failed}, models[reference])
    known = models[reference]
    chosen = _planned(known, seed, workers, hint)
    if chosen.solution is None:
        return Comparison({**dict.fromkeys(others, PlannedPosture()), reference: chosen}, known)
    basis = chosen.solution.basis
    plans = {name: _planned(_scattering(models[name], known.sources), seed, workers, hint) for name in others}
    judged = {name: _judged(plan, known, basis, measured) for name, plan in (plans | {reference: chosen}).items()}
    return Comparison(judged, known)


def _scattering(model: ProblemData, sources: Sources) -> ProblemData:
    """The model, under other sources of error where it states none itself."""
    return replace(model, sources=sources) if model.sources.empty else model


def _planned(problem: ProblemData, seed: int | None, workers: int, hint: str) -> PlannedPosture:
    told = (hint,) if hint else ()
    if far := _far_away(problem):
        return PlannedPosture(reasons=(far, *told))
    try:
        if problem.task is not None and problem.task.on_path:
            hint = "plan one point of it: task: {kind: trace, position: [...]}"
            raise InputError(Issue("models are not compared along a path", ("task", "path"), hint=hint))
        return PlannedPosture(planned_posture(problem, seed=seed, workers=workers))
    except (NoSolutionError, InputError, SolverError) as error:
        return PlannedPosture(reasons=(*str(error).splitlines(), *told))


def _judged(plan: PlannedPosture, reference: ProblemData, basis: Array, measured: Array | None) -> PlannedPosture:
    if plan.solution is None:
        return plan
    return PlannedPosture(plan.solution, predicted_error(reference, plan.solution, basis, measured), plan.reasons)


def _far_away(problem: ProblemData) -> str:
    """Why the target is out of reach of any arm of this length, or an empty text; a search would take much longer."""
    robot, task = problem.robot, problem.task
    assert task is not None
    if task.position is None:
        return ""
    first, longest = stretched(robot)
    distance = float(np.linalg.norm(np.array(task.position) - first))
    if distance <= longest:
        return ""
    return (
        f"the target is out of reach: {distance:.2f} m from the first joint, and the arm stretches to {longest:.2f} m"
    )


def predicted_error(problem: ProblemData, solution: Solution, basis: Array, measured: Array | None) -> PredictedError:
    """As ``problem`` predicts it at the posture of a solution that another model may have chosen."""
    spread = propagate(problem, solution.q)
    wanted = np.clip(solution.spread.position, solution.target.lower, solution.target.upper)
    miss = spread.position + spread.bias - wanted
    across, C = basis.T @ miss, basis.T @ spread.covariance @ basis
    return PredictedError(
        miss=miss,
        across=across,
        sigma_max=deviation(float(np.linalg.eigvalsh(C)[-1]), spread.covariance),
        critical_error=coverage_radius(0.95, C, across),
        success_probability=within_clearance(C, solution.target.clearance, across),
        covariance=spread.covariance,
        parts=spread_parts(spread, basis),
        from_measured=None if measured is None else PostureDistance.of(problem.robot, np.array(solution.q), measured),
    )
