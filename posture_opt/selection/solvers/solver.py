"""``Solver``: what polishes a feasible posture into a locally optimal one.

Building and solving are two steps: the functions of a program are compiled once and called for every start and target.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from posture_opt.limits import MOST_STARTS
from posture_opt.selection.program.nlp import Nlp
from posture_opt.spec import Spec


@dataclass(frozen=True)
class Outcome:
    """One local solve.

    Args:
        x: (n,) the point where it ended, within the bounds of the variables.
        optimal: whether the solver's own test of optimality is met.
        message: its status in its own words.
        iterations: that it took.
        residual: the largest one of the optimality conditions, scaled.
        row_multipliers: (m,) and ``bound_multipliers`` (n,) of the scaled objective, positive at upper ends.
    """

    x: np.ndarray
    optimal: bool
    message: str
    iterations: int
    residual: float
    row_multipliers: np.ndarray
    bound_multipliers: np.ndarray


Ends = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Lower and upper ends of the variables (n,), then of the rows (m,)."""

Polish = Callable[[np.ndarray, np.ndarray, Ends], Outcome]
"""(start (n,), target parameters, ends) -> outcome."""


class Solver(Spec):
    """A local solver, the starts of a batch (default: by the freedom that is left) and the seed they are drawn with.

    ``tolerance`` is that of the optimality conditions, scaled: the objective is of order one by its construction. The
    same seed gives the same answer, whatever the number of workers.
    """

    summary: ClassVar[str]
    """One line for ``optimize-posture list``."""

    kind: str
    starts: int | None = Field(
        default=None,
        ge=1,
        le=MOST_STARTS.most,
        description="postures that the search begins at; by default as many as there is freedom left for",
    )
    seed: int = Field(default=0, ge=0, description="of the random starts: the same seed, the same answer")
    tolerance: float = Field(default=1e-6, gt=0, description="of the optimality conditions, scaled")

    @abstractmethod
    def build(self, nlp: Nlp, *, confirms: bool = False) -> Polish:
        """A function that solves ``nlp`` locally, again and again: (start (n,), target parameters (30,), ends of
        variables and rows) -> outcome.

        Args:
            confirms: starts are optima that another method found: tolerances are as tight as rounding allows.
        """
