"""The objective of a task and its gradient as functions of the joints alone, for export."""

from __future__ import annotations

import casadi as ca

from posture_opt.selection.has_task import HasTask
from posture_opt.selection.selector import PostureSelector

DESCRIPTIONS = {
    "q": "joint values [rad or m]",
    "objective": "what the selection minimises: {told}",
    "gradient": "of the objective by the joints",
}


def task_objective(problem: HasTask) -> tuple[ca.Function, dict[str, str]]:
    """``q -> (objective, gradient)`` with ``gradient = ∂objective/∂q`` (n,), and a description of each.

    By the criterion ``worst`` the objective is the largest variance [m²] in the directions that the task minds, as the
    selection has it; further terms of the task are added with their weights, and the variance is not scaled.

    Raises:
        InputError: no task, several targets, or a task that the arm cannot do.
    """
    selector = PostureSelector(problem, compiled=False)
    found = selector.engine(selector.target).optimisation_problem
    nlp = found.nlp
    objective = ca.substitute(nlp.objective, nlp.p, ca.DM(selector.target.parameters))
    q = ca.SX.sym("q", nlp.x.numel())
    value = ca.substitute(objective, nlp.x, q)
    gradient = ca.densify(ca.gradient(value, q))
    told = " + ".join(label.replace(", over scale", " [m^2]") for label, _ in nlp.terms)
    function = ca.Function("objective", [q], [ca.cse(value), gradient], ["q"], ["objective", "gradient"])
    return function, {key: text.format(told=told) for key, text in DESCRIPTIONS.items()}
