"""Term ``orientation_spread``: how far the errors tilt the tool, or turn it about its axis.

For tasks whose tool has to stay upright or in its yaw, whatever the position of its point.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field

from posture_opt.selection.terms import criteria
from posture_opt.selection.terms.term import Quantities, StandardDeviationTerm
from posture_opt.units import Angle

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
