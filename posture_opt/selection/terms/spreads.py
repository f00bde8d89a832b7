"""Terms of the errors of the tool, beside the spread that the task minimises: spread, tilt and probability."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from posture_opt.errors import InputError, Issue
from posture_opt.selection.terms import criteria
from posture_opt.selection.terms.term import Quantities, StandardDeviationTerm, Stated, Term
from posture_opt.uncertainty.clearance import Within
from posture_opt.units import Angle, Length


class SpreadTerm(StandardDeviationTerm):
    """The largest standard deviation ``sqrt(λ_max(Bᵀ C B))`` [m] across the direction, along it, or in any direction.

    C (3, 3) is the exact covariance of the tool point in the world [m²] and B (3, m) the basis of that part.
    """

    summary: ClassVar[str] = "largest standard deviation across | along the direction, or all of it"
    unit: ClassVar[str] = "m"

    kind: Literal["spread"]
    within: Within = Field("along", description="which part of it counts: across the direction, along it, or all")
    at_most: Annotated[Length, Field(gt=0)] | None = Field(
        None, description="bound of the standard deviation of its worst axis"
    )

    @property
    def part(self) -> Within | None:
        return self.within

    def quantity(self, at: Quantities) -> ca.SX:
        return ca.sqrt(criteria.worst(at.projected(self.within)[0]))


Rotation = Literal["tilt", "spin", "all"]


class OrientationSpread(StandardDeviationTerm):
    """The largest standard deviation of the rotation of the tool [rad]: tilt of its axis, spin about it, or any.

    ``sqrt(λ_max(Bᵀ J Σ Jᵀ B))`` with the rotation rows J (3, k) of the tool and B (3, m) the two directions across its
    axis, the axis itself, or all three: first order, as rotation vectors have no closed form beyond.
    """

    summary: ClassVar[str] = "largest standard deviation of the tilt of the tool axis, of the spin, or of all (at_most)"
    unit: ClassVar[str] = "rad"

    uses_orientation: ClassVar[bool] = True

    kind: Literal["orientation_spread"]
    of: Rotation = Field("tilt", description="the tilt of the tool axis, its spin, or every rotation")
    at_most: Annotated[Angle, Field(gt=0)] | None = Field(None, description="bound of its standard deviation")

    def quantity(self, at: Quantities) -> ca.SX:
        C, axis = at.turning, at.axis
        variance = {"tilt": criteria.worst_across(C, axis), "spin": ca.dot(axis, C @ axis), "all": criteria.worst(C)}
        # A tool that no error turns still has a slope: 1e-9 rad is far below any arm.
        return ca.sqrt(variance[self.of] + 1e-18)

    def labels(self, at: Quantities) -> list[str]:
        return [f"orientation_spread of the {self.of}" if self.of != "all" else "orientation_spread"]


class Success(Term):
    """Probability that the tool point stays within the clearance of the task, by the logarithm of a miss.

    ``ln P(miss) ≤ ln(1 − at_least)``: it has a slope where the probability itself is 1 to the last digit. In
    ``minimize`` the logarithm itself is what is made small. With a peg both ends have to stay within, and the bound of
    Boole replaces their joint probability: it is on the safe side, by at most a factor of two of the miss.
    """

    summary: ClassVar[str] = "probability to stay within the clearance (at_least)"
    unit: ClassVar[str] = "probability"

    kind: Literal["success"]
    at_least: Annotated[float, Field(gt=0, lt=1)] | None = Field(
        None, description="probability to stay within the clearance"
    )

    def quantity(self, at: Quantities) -> ca.SX:
        if not at.has_hole:
            hint = "add for example clearance: 0.2 mm"
            raise InputError(Issue("success needs the clearance of the hole", ("task", "clearance"), hint=hint))
        return at.log_miss

    def cost(self, at: Quantities) -> ca.SX:
        return self.quantity(at)

    def bounds(self) -> tuple[float, float]:
        return -math.inf, math.inf if self.at_least is None else math.log1p(-self.at_least)

    def stated(self) -> list[Stated]:
        return [Stated(self.at_least or 0.0, math.inf, self.unit)]

    def shown(self, value: float) -> float:
        return -math.expm1(min(value, 0.0))
