"""Solver ``ipopt``: the interior-point method of Wächter and Biegler (2006), as it comes with CasADi."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.selection.program.nlp import Nlp, NonlinearSolver, Outcome
from posture_opt.selection.solvers.solver import Ends, Polish, Solver

# Of the optimality conditions at an optimum that another method found: a thousandth of what that is asked for.
CONFIRMING_TOLERANCE = 1e-9


class Ipopt(Solver):
    """IPOPT with exact Hessians, started close to a feasible posture, for starts at which the local search stalls.

    Starts are feasible, so that it begins with a small barrier (``mu_init`` 1e-6) instead of walking away from them,
    and a point that is merely acceptable does not count as an optimum.
    """

    summary: ClassVar[str] = "sequential quadratic programming from every start; IPOPT confirms the answer"

    kind: Literal["ipopt"] = Field("ipopt", description="the solver")
    max_iterations: int = Field(default=200, ge=1, description="of one local search")

    def build(self, nlp: Nlp, *, confirms: bool = False) -> Polish:
        options = {
            "ipopt.max_iter": self.max_iterations,
            "ipopt.constr_viol_tol": 1e-9,
            # A point that is merely acceptable is where a flat valley was given up: it would pose as an optimum.
            "ipopt.acceptable_iter": 0,
            "ipopt.fixed_variable_treatment": "make_parameter",
            **(self._at_an_optimum if confirms else self._near_a_start),
        }
        solver = NonlinearSolver("solver", nlp.as_casadi(), options)

        def polish(start: np.ndarray, parameters: np.ndarray, ends: Ends) -> Outcome:
            found = solver.solve(start, *ends, p=parameters)
            inside = replace(found, x=np.clip(found.x, *ends[:2]))
            known = np.all(np.isfinite(found.x))
            return replace(inside, residual=solver.residual(inside, *ends, p=parameters) if known else np.inf)

        return polish

    @property
    def _near_a_start(self) -> dict[str, Any]:
        return {
            "ipopt.tol": self.tolerance,
            "ipopt.mu_init": 1e-6,
            "ipopt.bound_push": 1e-6,
            "ipopt.bound_frac": 1e-6,
            "ipopt.constr_mult_init_max": 0.0,  # no factorisation for a first guess of the multipliers
        }

    @property
    def _at_an_optimum(self) -> dict[str, Any]:
        # Ten times the last barrier, so that at least one iteration is made.
        return {
            "ipopt.tol": min(CONFIRMING_TOLERANCE, self.tolerance),
            "ipopt.mu_init": 10 * CONFIRMING_TOLERANCE,
            "ipopt.bound_push": 10 * CONFIRMING_TOLERANCE,
            "ipopt.bound_frac": 10 * CONFIRMING_TOLERANCE,
            "ipopt.bound_mult_init_method": "mu-based",
        }
