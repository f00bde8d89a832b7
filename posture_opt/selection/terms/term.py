"""``Term``: one quantity to minimise beside the task's own, or to keep within bounds."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import casadi as ca
from pydantic import Field, model_validator

from posture_opt.selection.quantities import Quantities
from posture_opt.spec import Spec


class Term(Spec):
    """A quantity of the posture; in ``minimize`` it has a ``weight``, in ``subject_to`` bounds of its own."""

    summary: ClassVar[str]
    """One line for ``optimize-posture list``."""
    unit: ClassVar[str]
    """SI unit of the quantity."""

    kind: str
    weight: float = Field(default=1.0, ge=0)

    @abstractmethod
    def quantity(self, at: Quantities) -> ca.SX:
        """The (k,) expression."""

    def labels(self, at: Quantities) -> list[str]:
        """A name for every entry of the quantity, for people."""
        return [self.kind]

    @abstractmethod
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound of every entry, infinite where there is none."""

    @abstractmethod
    def scale(self, at: Quantities) -> float:
        """A typical size of the quantity: rows and objective are divided by it."""


class BoundedTerm(Term):
    """A term that must state at least one bound where it stands in ``subject_to``."""

    @model_validator(mode="after")
    def _not_crossed(self) -> BoundedTerm:
        low, high = self.bounds()
        if low > high:
            raise ValueError("at_least is above at_most; swap them")
        return self
