"""``Term``: one quantity to minimise beside the task's own, or to keep within bounds; ``Quantities``: its symbols."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
from pydantic import Field, model_validator

from posture_opt.errors import BadValueError
from posture_opt.robot.robot import Robot
from posture_opt.spec import Spec
from posture_opt.uncertainty.task_spread import Within


@dataclass(frozen=True)
class Quantities:
    """Expressions in the joints ``q`` (n,) and in the target's parameters.

    Args:
        position: (3,) nominal tool point in the world [m].
        axis: (3,) tool axis in the world.
        frames: (3, n) origins of the frames behind the joints, world [m].
        covariance: (3, 3) exact covariance of the tool point [m²], world frame.
        bias: (3,) exact mean minus nominal [m].
        jacobian: (r, n) Jacobian of the tool point in the r directions that the arm can move it in [m/rad].
        bases: (3, m) orthonormal bases, for each part of the spread that can be asked for.
        clearance: radial clearance of the hole [m].
    """

    robot: Robot
    q: ca.SX
    position: ca.SX
    axis: ca.SX
    frames: ca.SX
    covariance: ca.SX
    bias: ca.SX
    jacobian: ca.SX
    bases: dict[Within, ca.SX]
    clearance: ca.SX

    def projected(self, within: Within) -> tuple[ca.SX, ca.SX]:
        """Covariance (m, m) [m²] and bias (m,) [m] of the part of the spread."""
        basis = self.bases[within]
        return basis.T @ self.covariance @ basis, basis.T @ self.bias


class Term(Spec):
    """A quantity of the posture; in ``minimize`` it has a ``weight``, in ``subject_to`` bounds of its own."""

    summary: ClassVar[str]
    """One line for ``optimize-posture list``."""
    unit: ClassVar[str]
    """SI unit of the quantity."""
    keeps_clear: ClassVar[bool] = False
    """Whether it keeps the arm away from what stands around it."""

    kind: str
    weight: float = Field(default=1.0, ge=0)

    @property
    def part(self) -> Within | None:
        """The part of the spread that it speaks of, None where it does not speak of the spread."""
        return None

    @abstractmethod
    def quantity(self, at: Quantities) -> ca.SX:
        """The (k,) expression [unit]."""

    def cost(self, at: Quantities) -> ca.SX:
        """What ``minimize`` adds to the objective at weight one: the squared quantity in units of its scale."""
        return ca.sumsqr(self.quantity(at) / self.scale(at))

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
            raise BadValueError("at_least is above at_most", "swap them")
        return self
