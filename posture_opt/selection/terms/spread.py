"""Term ``spread``: a standard deviation of the tool point, beside the one that the task minimises.

For example the depth of an insertion, which the task itself does not look at, kept below a bound.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from posture_opt.selection.terms import criteria
from posture_opt.selection.terms.term import Quantities, StandardDeviationTerm
from posture_opt.uncertainty.regions.clearance import Within
from posture_opt.units import Length


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
