"""``YawSpread``: how far a part that is put down is turned about the direction, and what its corners make of that."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array, Json
from posture_opt.uncertainty.regions.critical import Critical


@dataclass(frozen=True)
class YawSpread:
    """Standard deviation of the rotation about the direction [rad], and the root mean square error of a corner [m].

    Args:
        lever: from the tool point to the corner [m]; zero where none is stated.
        corner: ``sqrt(E|e|² + lever² Var(yaw))`` with the error e across the direction, its mean included, averaged
            over corners all round.
    """

    sigma: float
    lever: float
    corner: float

    @classmethod
    def of(cls, turning: Array, direction: Array, lever: float, critical: Critical) -> YawSpread:
        """The yaw of a covariance of the rotation.

        Args:
            turning: (3, 3) [rad²], world.
            direction: (3,) unit vector that the yaw is about, world.
            lever: from the tool point to the corner [m].
            critical: the spread across the direction.
        """
        variance = max(float(direction @ turning @ direction), 0.0)
        square = float(np.trace(critical.covariance) + critical.bias @ critical.bias) + lever**2 * variance
        return cls(math.sqrt(variance), lever, math.sqrt(max(square, 0.0)))

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI."""
        return {"sigma": self.sigma, "lever": self.lever or None, "corner_rms": self.corner if self.lever else None}
