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
    """

    x: Array
    optimal: bool
    message: str
    iterations: int


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
        x, message = np.asarray(found["x"]).ravel(), str(stats["return_status"])
        return SolverAnswer(x, message == "Solve_Succeeded", message, int(stats["iter_count"]))
