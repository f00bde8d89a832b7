"""The solvers: one file each, listed here."""

from __future__ import annotations

from posture_opt.selection.solvers.ipopt import Ipopt
from posture_opt.selection.solvers.solver import Outcome, Polish, Solver

SOLVERS: tuple[type[Solver], ...] = (Ipopt,)

SolverSpec = Ipopt

__all__ = ["SOLVERS", "Outcome", "Polish", "Solver", "SolverSpec"]
