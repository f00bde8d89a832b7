"""Term ``success``: the probability to stay within the clearance, as a requirement or as the objective."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from posture_opt.errors import InputError, Issue
from posture_opt.selection.terms.term import Quantities, Stated, Term


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
