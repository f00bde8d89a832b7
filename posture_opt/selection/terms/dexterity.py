"""Terms of the Jacobian of the tool point: distance from singular postures, and how far joints move the tool."""

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


class Manipulability(LowerBoundedTerm):
    """Geometric mean ``det(J Jᵀ)^(1/2r)`` [m/rad] of the r singular values of the position Jacobian J (r, n).

    T. Yoshikawa, Int. J. Robotics Research 4 (1985) 3, eq. 6, is its r-th power, whose unit depends on the arm. In
    ``minimize`` the squared inverse is what is made small. At a singular posture it is 1 % of the root mean square of
    the singular values instead of zero, so that there is a slope that leads away.
    """

    summary: ClassVar[str] = "geometric mean of the singular values of the position Jacobian, m per rad (at_least)"
    unit: ClassVar[str] = "m/rad"
    size: ClassVar[float] = 0.1

    kind: Literal["manipulability"]
    at_least: Length = Field(0.0, description="geometric mean of the singular values, as a length per rad")

    def quantity(self, at: Quantities) -> ca.SX:
        if not at.jacobian.shape[0]:  # no joint moves the tool point
            return ca.SX(0, 1)
        return ca.sqrt(criteria.area(at.jacobian @ at.jacobian.T))

    def cost(self, at: Quantities) -> ca.SX:
        return ca.sumsqr(self.size / self.quantity(at))
