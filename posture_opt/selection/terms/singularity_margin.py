"""Term ``singularity_margin``: distance from postures in which the tool point cannot move in some direction."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca
from pydantic import Field

from posture_opt.selection.terms import criteria
from posture_opt.selection.terms.term import LowerBoundedTerm, Quantities
from posture_opt.units import Length


class SingularityMargin(LowerBoundedTerm):
    """Smallest singular value σ_min(J) [m/rad] of the tool point's Jacobian J (r, n), written as a length per radian.

    It is the shortest semi-axis of the velocities of the tool point under joint velocities of norm one. At zero one of
    the r directions that the arm has is lost, and the first-order ellipse has a false axis of length zero.
    """

    summary: ClassVar[str] = "smallest singular value of the position Jacobian, m per rad (at_least)"
    unit: ClassVar[str] = "m/rad"
    size: ClassVar[float] = 0.1

    kind: Literal["singularity_margin"]
    at_least: Length = Field(0.0, description="smallest singular value, as a length per rad")

    def quantity(self, at: Quantities) -> ca.SX:
        smallest = criteria.eigenvalues(at.jacobian @ at.jacobian.T)[0]
        # The rounding of equal eigenvalues can push a zero just below zero.
        return ca.sqrt(ca.fmax(smallest, 0) + 1e-12)
