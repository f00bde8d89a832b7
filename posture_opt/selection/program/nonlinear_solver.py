"""``NonlinearSolver``: IPOPT as it comes with CasADi, one solve at a time, which an interrupt ends.

Wächter and Biegler, Mathematical Programming 106 (2006) 25–57, with the linear solver MUMPS of CasADi's wheel.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from posture_opt.interrupts import interruptible
from posture_opt.numerics import Array

_OPTIONS: dict[str, Any] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",  # no banner
    "print_time": False,
    "calc_lam_p": False,  # the multipliers of the parameters cost one more evaluation and nobody reads them
}

_SCALE = 100.0
"""Mean multiplier above which residuals are divided by it (s_max of IPOPT)."""

_ONE_AT_A_TIME = threading.RLock()
"""MUMPS, which solves IPOPT's linear systems, keeps data in global variables: of all threads, one may solve."""

if hasattr(os, "register_at_fork"):  # what another thread held goes on being held in a child, where nobody lets go
    os.register_at_fork(after_in_child=_ONE_AT_A_TIME._at_fork_reinit)  # type: ignore[attr-defined]


@dataclass(frozen=True)
class SolverAnswer:
    """Where a solve ended.

    Args:
        x: (n,) the variables.
        optimal: IPOPT's status is ``Solve_Succeeded``; a merely acceptable point is not.
        message: IPOPT's status.
        iterations: that it took.
        row_multipliers: (m,) and ``bound_multipliers`` (n,), positive at upper ends: ``∇f + Jᵀλ + z = 0``.
    """

    x: Array
    optimal: bool
    message: str
    iterations: int
    row_multipliers: Array
    bound_multipliers: Array


class NonlinearSolver:
    """``min f(x, p)`` subject to bounds on x and on g(x, p); threads may share it and solve in turn.

    Args:
        name: for CasADi's messages.
        program: ``x``, ``f``, ``g`` and, where there are parameters, ``p``: symbols of CasADi.
        options: of IPOPT, over those that keep it silent.
    """

    def __init__(self, name: str, program: Mapping[str, Any], options: Mapping[str, Any]) -> None:
        with _ONE_AT_A_TIME:
            self._function = ca.nlpsol(name, "ipopt", dict(program), {**_OPTIONS, **options})

    def solve(
        self, x0: Array, lower: Array, upper: Array, row_lower: Array, row_upper: Array, p: Any = ()
    ) -> SolverAnswer:
        """The local optimum from ``x0`` (n,), within bounds of the variables (n,) and rows (m,).

        Bounds of a variable that are equal fix it. Other threads that want to solve wait until this one is done.

        Raises:
            KeyboardInterrupt: as anything else that a signal handler raises while IPOPT works.
        """
        with _ONE_AT_A_TIME, interruptible():
            found = self._function(x0=x0, p=p, lbx=lower, ubx=upper, lbg=row_lower, ubg=row_upper)
            stats = self._function.stats()
        x, rows, bounds = (np.asarray(found[name]).ravel() for name in ("x", "lam_g", "lam_x"))
        message = str(stats["return_status"])
        return SolverAnswer(x, message == "Solve_Succeeded", message, int(stats["iter_count"]), rows, bounds)

    def residual(
        self, found: SolverAnswer, lower: Array, upper: Array, row_lower: Array, row_upper: Array, p: Any = ()
    ) -> float:
        """The largest residual of the optimality conditions at an answer, scaled as IPOPT scales them.

        ``max(|∇f + Jᵀλ + z|/s, |(λ, z)|·room/s, violation)`` with ``s = max(100, mean |(λ, z)|)/100`` (Wächter and
        Biegler 2006, eqs. 5 and 6), evaluated here and not taken from the solver. ``room`` is what a value has left to
        the end that its multiplier belongs to. Arguments as of `solve`.
        """
        slope = np.asarray(self._function.get_function("nlp_grad_f")(found.x, p)[1]).ravel()
        g, jacobian = self._function.get_function("nlp_jac_g")(found.x, p)
        free = lower < upper  # the solver takes the others as numbers
        stationarity = (slope + np.asarray(jacobian.T @ found.row_multipliers).ravel() + found.bound_multipliers)[free]
        value, low, high = (
            np.concatenate(pair) for pair in ((np.asarray(g).ravel(), found.x), (row_lower, lower), (row_upper, upper))
        )
        y = np.concatenate([found.row_multipliers, np.where(free, found.bound_multipliers, 0.0)])
        room = np.maximum(np.where(y > 0, high - value, value - low), 0.0)
        ended = np.isfinite(room)  # where there is no end, a multiplier is what is left of a barrier
        complementarity = np.abs(y[ended]) * room[ended]
        violation = np.maximum(low - value, value - high)
        scale = max(_SCALE, float(np.mean(np.abs(y)))) / _SCALE
        scaled = max(np.max(np.abs(stationarity), initial=0.0), np.max(complementarity, initial=0.0)) / scale
        return float(max(scaled, np.max(violation, initial=0.0)))
