"""How far the tool leans and turns by the errors: tilt and spin of its axis, yaw of a part that is put down."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.model.chain import Vector
from posture_opt.numerics import Array, Json
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.regions.critical import Critical


@dataclass(frozen=True)
class Orientation:
    """Standard deviations of the rotation of the tool [rad], from the covariance of the pose and from ``J Σ Jᵀ``."""

    tilt: float  # largest one of the tilt of the tool axis
    spin: float  # about that axis
    tilt_first_order: float
    spin_first_order: float

    @classmethod
    def of(cls, tool_point: ToolPoint, q: Sequence[float], turning: Array, tool_axis: Vector) -> Orientation:
        """At a posture (n,) with the covariance ``turning`` (3, 3) [rad²], world; the axis (3,) in the tool frame."""
        reached, _ = tool_point.walk(q)
        axis = np.array(reached.columns, dtype=float).T @ (np.array(tool_axis) / math.hypot(*tool_axis))
        linear = np.asarray(tool_point.pose_first_order(q, reached), dtype=float)
        return cls(*_tilt_and_spin(turning, axis), *_tilt_and_spin(linear[3:, 3:], axis))

    @property
    def first_order_error(self) -> float:
        """Relative error of the first-order values, the larger one."""
        sizes = ((self.tilt, self.tilt_first_order), (self.spin, self.spin_first_order))
        return max((abs(linear / exact - 1) for exact, linear in sizes if exact > 0), default=0.0)

    def to_json(self) -> dict[str, Json]:
        return {
            "tilt_sigma_max": self.tilt,
            "spin_sigma": self.spin,
            "tilt_sigma_max_first_order": self.tilt_first_order,
            "spin_sigma_first_order": self.spin_first_order,
        }


def _tilt_and_spin(turning: Array, axis: Array) -> tuple[float, float]:
    """Largest standard deviation across an axis (3,), and about it, of a rotation with covariance (3, 3)."""
    across = axes_across(axis)
    tilt = float(np.linalg.eigvalsh(across.T @ turning @ across)[-1])
    return math.sqrt(max(tilt, 0.0)), math.sqrt(max(float(axis @ turning @ axis), 0.0))


def axes_across(axis: Array) -> Array:
    """(3, 2) orthonormal columns across an axis (3,)."""
    return np.asarray(np.linalg.svd(axis[None])[2][1:].T)


@dataclass(frozen=True)
class YawSpread:
    """How far a part that is put down is turned about the direction, and what its corners make of that."""

    sigma: float  # standard deviation of the rotation about the direction [rad]
    lever: float  # from the tool point to the corner [m]; zero where none is stated
    corner: float  # √(E|e|² + lever² Var(yaw)) [m], e the error across with its mean, over corners all round

    @classmethod
    def of(cls, turning: Array, direction: Array, lever: float, critical: Critical) -> YawSpread:
        """By the covariance ``turning`` (3, 3) [rad²] and the unit vector (3,) that the yaw is about, world."""
        variance = max(float(direction @ turning @ direction), 0.0)
        square = float(np.trace(critical.covariance) + critical.bias @ critical.bias) + lever**2 * variance
        return cls(math.sqrt(variance), lever, math.sqrt(max(square, 0.0)))

    def to_json(self) -> dict[str, Json]:
        return {"sigma": self.sigma, "lever": self.lever or None, "corner_rms": self.corner if self.lever else None}
