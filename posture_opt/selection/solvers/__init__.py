"""The solvers: one file each, listed here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.selection.program.nlp import Outcome
from posture_opt.selection.solvers.ipopt import Ipopt
from posture_opt.selection.solvers.solver import Ends, Polish, Solver
from posture_opt.spec import one_of

SOLVERS: tuple[type[Solver], ...] = (Ipopt,)

if TYPE_CHECKING:
    SolverSpec = Solver
else:
    SolverSpec = one_of(SOLVERS)

__all__ = ["SOLVERS", "Ends", "Outcome", "Polish", "Solver", "SolverSpec"]
