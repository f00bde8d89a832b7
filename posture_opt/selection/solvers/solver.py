"""``Solver``: what polishes a feasible posture into a locally optimal one."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from posture_opt.selection.program.nlp import Nlp
from posture_opt.spec import Spec


@dataclass(frozen=True)
class Outcome:
    """One local solve: the point (n,), whether the solver calls it optimal, and its own words."""

    x: np.ndarray
    optimal: bool
    message: str


Polish = Callable[[np.ndarray, np.ndarray], Outcome]
"""(start (n,), target parameters) -> outcome."""


class Solver(Spec):
    """A local solver, the starts of a batch (default: by the freedom that is left) and the seed they are drawn with."""

    summary: ClassVar[str]
    """One line for ``optimize-posture list``."""

    kind: str
    starts: int | None = Field(default=None, ge=1, le=100_000)
    seed: int = Field(default=0, ge=0)
    tolerance: float = Field(default=1e-6, gt=0)

    @abstractmethod
    def build(self, nlp: Nlp) -> Polish:
        """A function that solves ``nlp`` locally, again and again."""
