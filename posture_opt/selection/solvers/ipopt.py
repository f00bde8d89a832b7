"""Solver ``ipopt``: the interior-point method of Wächter and Biegler (2006), as it comes with CasADi."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.selection.program.nlp import Nlp
from posture_opt.selection.program.nonlinear_solver import NonlinearSolver
from posture_opt.selection.solvers.solver import Outcome, Polish, Solver


class Ipopt(Solver):
    """IPOPT with exact Hessians, started close to a feasible posture, for starts at which the local search stalls.

    Starts are feasible, so that it begins with a small barrier (``mu_init`` 1e-6) instead of walking away from them,
    and a point that is merely acceptable does not count as an optimum.
    """

    summary: ClassVar[str] = "sequential quadratic programming from every start; IPOPT where that does not converge"

    kind: Literal["ipopt"] = "ipopt"
    max_iterations: int = Field(default=200, ge=1)

    def build(self, nlp: Nlp) -> Polish:
        options = {
            "ipopt.tol": self.tolerance,
            "ipopt.max_iter": self.max_iterations,
            "ipopt.constr_viol_tol": 1e-9,
            # Starts are feasible: begin near them, with a small barrier, instead of walking away from them.
            "ipopt.mu_init": 1e-6,
            "ipopt.constr_mult_init_max": 0.0,  # no factorisation for a first guess of the multipliers
            "ipopt.bound_push": 1e-6,
            "ipopt.bound_frac": 1e-6,
            # A point that is merely acceptable is where a flat valley was given up: it would pose as an optimum.
            "ipopt.acceptable_iter": 0,
            "ipopt.fixed_variable_treatment": "make_parameter",
        }
        solver = NonlinearSolver("solver", nlp.as_casadi(), options)
        lower, upper = nlp.variable_bounds

        def polish(start: np.ndarray, parameters: np.ndarray) -> Outcome:
            found = solver.solve(start, lower, upper, *nlp.row_bounds(parameters), p=parameters)
            return Outcome(np.clip(found.x, lower, upper), found.optimal, found.message)

        return polish
