"""``Orientation``: how far the tool leans and turns about its axis by the errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from posture_opt.model.chain import Vector
from posture_opt.numerics import Array, Json
from posture_opt.uncertainty.spread.spread import Spread


@dataclass(frozen=True)
class Orientation:
    """Standard deviations of the rotation of the tool [rad].

    From the covariance of the pose; those to first order are of ``J Σ Jᵀ``, which terms bound and minimise.

    Args:
        tilt: largest one of the tilt of the tool axis; ``spin``: about that axis.
        tilt_first_order, spin_first_order: the same to first order.
    """

    tilt: float
    spin: float
    tilt_first_order: float
    spin_first_order: float

    @classmethod
    def of(cls, spread: Spread, tool_axis: Vector) -> Orientation:
        """The orientation at the posture of a spread.

        Args:
            spread: with its pose covariance.
            tool_axis: (3,) of any length, tool frame.
        """
        tool_point, q = spread.tool_point, spread.q
        reached, _ = tool_point.walk(q)
        axis = np.array(reached.columns, dtype=float).T @ (np.array(tool_axis) / math.hypot(*tool_axis))
        linear = np.asarray(tool_point.pose_first_order(q, reached), dtype=float)
        return cls(*_tilt_and_spin(spread.pose_covariance[3:, 3:], axis), *_tilt_and_spin(linear[3:, 3:], axis))

    @property
    def first_order_error(self) -> float:
        """Relative error of the first-order values, the larger one."""
        sizes = ((self.tilt, self.tilt_first_order), (self.spin, self.spin_first_order))
        return max((abs(linear / exact - 1) for exact, linear in sizes if exact > 0), default=0.0)

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI."""
        return {
            "tilt_sigma_max": self.tilt,
            "spin_sigma": self.spin,
            "tilt_sigma_max_first_order": self.tilt_first_order,
            "spin_sigma_first_order": self.spin_first_order,
        }


def _tilt_and_spin(turning: Array, axis: Array) -> tuple[float, float]:
    """Largest standard deviation across an axis (3,), and about it, of a rotation with covariance (3, 3)."""
    across = np.linalg.svd(axis[None])[2][1:].T
    tilt = float(np.linalg.eigvalsh(across.T @ turning @ across)[-1])
    return math.sqrt(max(tilt, 0.0)), math.sqrt(max(float(axis @ turning @ axis), 0.0))
