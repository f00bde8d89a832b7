"""What terms are made of: the symbolic quantities at one posture of the programme."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import casadi as ca

from posture_opt.robot.robot import Robot

Within = Literal["across", "along", "all"]


@dataclass(frozen=True)
class Quantities:
    """Expressions in the joints ``q`` (n,) and in the goal's parameters.

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
