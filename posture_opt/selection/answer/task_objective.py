"""The objective of a task with its first and second derivatives as functions of the joints alone, for export."""

from __future__ import annotations

import casadi as ca

from posture_opt.selection.answer.selector import PostureSelector
from posture_opt.selection.problem_data import ProblemData

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
