"""Term ``spread``: a standard deviation of the tool point."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from posture_opt.selection.terms import criteria
from posture_opt.selection.terms.standard_deviation import StandardDeviationTerm
from posture_opt.selection.terms.term import Quantities
from posture_opt.uncertainty.regions.critical import Within
from posture_opt.units import Length


class SpreadTerm(StandardDeviationTerm):
    """The largest standard deviation across the direction, along it, or in any direction [m]."""

    summary: ClassVar[str] = "largest standard deviation across | along the direction, or all of it"
    unit: ClassVar[str] = "m"

    kind: Literal["spread"]
    within: Within = "along"
    at_most: Length | None = None

    @property
    def part(self) -> Within | None:
        return self.within

    def quantity(self, at: Quantities) -> ca.SX:
        return ca.sqrt(criteria.worst(at.projected(self.within)[0]))
