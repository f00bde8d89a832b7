"""The posture of greatest manipulability that does the same task: what the usual rule of thumb would have chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array, Json
from posture_opt.robot.posture import Posture
from posture_opt.selection.program.optimisation_problem import OptimisationProblem
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.solvers import Solver
from posture_opt.selection.terms.manipulability import Manipulability

_IMPROVED_STARTS = 4  # starts of greatest manipulability that the solver improves
_MANIPULABILITY_TOLERANCE = 1e-4  # relative: of postures that are as good, the one that scatters least is reported


@dataclass(frozen=True)
class ManipulablePosture:
    """A posture (joint name -> rad or m), its manipulability [m/rad] and its σ_max [m]."""

    posture: Posture
    manipulability: float
    sigma_max: float

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI."""
        return {"posture": self.posture, "manipulability": self.manipulability, "sigma_max": self.sigma_max}


def most_manipulable(
    problem: OptimisationProblem, target: TaskTarget, solver: Solver, Q: Array
) -> ManipulablePosture | None:
    """The best that the solver finds from the feasible postures (N, n) of a search.

    The rows of the task hold; the spread plays no part. None where no posture is feasible, and of an arm whose tool
    point no joint moves.
    """
    if not len(Q) or not problem.quantities.jacobian.shape[0]:
        return None
    nlp, term = problem.nlp, Manipulability(kind="manipulability")
    cost = term.cost(problem.quantities)
    asked = replace(nlp, objective=cost, terms=((term.kind, cost),))
    measured = BatchFunction(
        ca.Function("manipulability", [nlp.x, nlp.p], [term.quantity(problem.quantities), nlp.variance]), compiled=False
    )
    sizes, _ = measured(Q, target.parameters)
    starts = Q[np.argsort(-sizes[:, 0], kind="stable")[:_IMPROVED_STARTS]]
    if problem.freedom:
        polish = solver.build(asked)
        ends = asked.ends(target.parameters)
        starts = np.vstack([starts, *_met(asked, target, [polish(q, target.parameters, ends).x for q in starts])])
    sizes, variances = (column[:, 0] for column in measured(starts, target.parameters))
    best = min(
        np.flatnonzero(sizes >= (1 - _MANIPULABILITY_TOLERANCE) * sizes.max()), key=lambda k: float(variances[k])
    )
    posture = Posture(problem.robot, starts[best])
    return ManipulablePosture(posture, float(sizes[best]), float(np.sqrt(max(variances[best], 0.0))))


def _met(nlp: Any, target: TaskTarget, found: Sequence[Array]) -> list[Array]:
    """Those of some postures (n,) that meet every row."""
    screen = BatchFunction(nlp.screen, compiled=False)
    return [q for q in found if np.all(np.isfinite(q)) and screen(q[None], target.parameters)[1][0, 0] <= ROW_TOLERANCE]
