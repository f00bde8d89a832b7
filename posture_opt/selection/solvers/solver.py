"""``Solver``: what polishes a feasible posture into a locally optimal one.

Building and solving are two steps: the functions of a program are compiled once and called for every start and target.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np
from pydantic import Field

from posture_opt.limits import MOST_STARTS
from posture_opt.selection.program.nlp import Nlp, Outcome
from posture_opt.spec import Spec

# Lower and upper ends of the variables (n,), then of the rows (m,).
Ends = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]

Polish = Callable[[np.ndarray, np.ndarray, Ends], Outcome]  # (start (n,), target parameters, ends) -> outcome


class Solver(Spec):
    """A local solver, the starts of a batch (default: by the freedom that is left) and the seed they are drawn with.

    ``tolerance`` is that of the optimality conditions, scaled: the objective is of order one by its construction. The
    same seed gives the same answer, whatever the number of workers.
    """

    summary: ClassVar[str]  # one line for ``optimize-posture list``

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
        """(start (n,), target parameters (33,), ends) -> outcome; ``confirms``: starts are optima."""
