"""``select_posture``: the answer to a problem, whatever its task asks for: one posture, one a feature, one a point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from typing import TypeAlias

import casadi as ca

from posture_opt.interrupts import interruptible
from posture_opt.numerics import Progress
from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.problem_data import ProblemData, task_of, with_fallbacks

Answer: TypeAlias = Solution
# Imported where a task needs them: one target is answered without.
_FEATURES, _PATHS = "posture_opt.selection.stations.features_selection", "posture_opt.selection.paths.path_selector"


def planned_posture(problem: ProblemData, *, seed: int | None = None, workers: int = 1) -> Solution:
    """The posture that represents an answer: the worst one of a path, or of several features."""
    return select_posture(problem, seed=seed, workers=workers).worst


def at_one_feature(
    models: Mapping[str, ProblemData], problem: ProblemData, *, seed: int | None, workers: int
) -> Mapping[str, ProblemData]:
    """The models at one target: the feature of ``problem`` that scatters most, where it is placed."""
    if problem.task is None or not problem.task.features:
        return models
    target = planned_posture(problem, seed=seed, workers=workers).target
    one = problem.task.model_copy(update={"features": (), "workpiece": None, "combine": "worst"})
    task = target.in_task(one)
    errors = problem.workpiece_sources
    return {name: replace(model, task=task, workpiece_sources=errors) for name, model in models.items()}


@interruptible()
def select_posture(
    problem: ProblemData, *, seed: int | None = None, workers: int = 1, progress: Progress | None = None
) -> Solution:
    """The posture whose spread hurts the task least, with alternatives and evidence; for a path one at each point.

    By the criterion ``worst`` it is ``min_q λ_max(Bᵀ C(q) B)``, the largest variance in the directions that count
    for the task: C (3, 3) [m²] the covariance of the tool point, B (3, m) a basis of those directions, both world;
    subject to the target, the tool axis, the limits of the joints and what the task adds. A task with features has a
    posture for each of them and one placement of the workpiece, chosen together.

    Args:
        problem: with a task and uncertain parameters.
        seed: of the random starts; the same seed gives the same answer. Default: the problem's.
        workers: processes that share the search; the answer does not depend on it.
        progress: called with (done, most) batches, or parts of a path's search.

    Returns:
        ``Solution``: ``posture`` (JOINT: rad or m), ``covariance`` (3, 3) [m²], ``sigma_max`` [m],
        ``alternatives``, ``budget``; of features and paths ``stations`` has one answer each.

    Raises:
        NoSolutionError: nothing feasible; carries the nearest posture and the reasons.
        InputError: no task, nothing uncertain, or a task that the arm cannot do.

    Example:
        >>> import posture_opt as po
        >>> solution = po.select_posture(po.load_problem("insert_planar_2r"))
        >>> solution.status, f"{1e3 * solution.sigma_max:.1f} mm"
        ('optimal', '14.3 mm')
    """
    task = task_of(problem)
    if task.features:
        of_features: Solution = import_module(_FEATURES).select_for_features(
            problem, seed=seed, workers=workers, progress=progress
        )
        return of_features
    if task.on_path:
        selector_of = import_module(_PATHS).PathSelector.of

        def along(one: ProblemData) -> Solution:
            found: Solution = selector_of(one).solve(seed=seed, workers=workers, progress=progress)
            return found

        return with_fallbacks(problem, along)
    return PostureSelector(problem, compiled=False).solve_thoroughly(seed=seed, workers=workers, progress=progress)


DESCRIPTIONS = {
    "q": "joint values [rad or m]",
    "objective": "what the selection minimises: {objective}",
    "gradient": "of the objective by the joints, per rad or m",
    "hessian": "second derivatives of the objective by the joints",
}


def task_objective(problem: ProblemData) -> tuple[ca.Function, dict[str, str]]:
    """``q -> (objective, ∂objective/∂q (n,), ∂²objective/∂q² (n, n))``, and a description of each.

    By the criterion ``worst`` it is the largest variance [m²] in the directions that count; further terms have their
    weights, and the variance is not scaled.
    """
    selector = PostureSelector(problem, compiled=False)
    found = selector.engine(selector.target).optimisation_problem
    nlp = found.nlp
    objective = ca.substitute(nlp.objective, nlp.p, ca.DM(selector.target.parameters))
    q = ca.SX.sym("q", nlp.x.numel())
    value = ca.substitute(objective, nlp.x, q)
    hessian, gradient = ca.hessian(value, q)
    entries = ca.cse([value, ca.densify(gradient), ca.densify(ca.triu2symm(ca.triu(hessian)))])
    minimised = " + ".join(label.replace(", over scale", " [m^2]") for label, _ in nlp.terms)
    minimised += "" if problem.workpiece_sources.empty else ", errors of the workpiece included"
    function = ca.Function("objective", [q], entries, ["q"], ["objective", "gradient", "hessian"])
    return function, {key: text.format(objective=minimised) for key, text in DESCRIPTIONS.items()}
