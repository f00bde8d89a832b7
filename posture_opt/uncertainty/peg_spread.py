"""How far the tool leans and turns by the errors, and what a peg in it does: success at both ends, contact, wedging."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.encoding import Encoded, encoded
from posture_opt.model.chain import Vector
from posture_opt.numerics import Array
from posture_opt.uncertainty.clearance import Critical, JointProbability, both_within, miss_probability
from posture_opt.uncertainty.pose_covariance import joint_covariance, pose_covariance, turn_of
from posture_opt.uncertainty.tool_point import ToolPoint


@dataclass(frozen=True)
class Orientation(
    Encoded,
    json="tilt_sigma_max=tilt spin_sigma=spin "
    "tilt_sigma_max_first_order=tilt_first_order spin_sigma_first_order=spin_first_order",
):
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


def _tilt_and_spin(turning: Array, axis: Array) -> tuple[float, float]:
    """Largest standard deviation across an axis (3,), and about it, of a rotation with covariance (3, 3)."""
    across = axes_across(axis)
    tilt = float(np.linalg.eigvalsh(across.T @ turning @ across)[-1])
    return math.sqrt(max(tilt, 0.0)), math.sqrt(max(float(axis @ turning @ axis), 0.0))


def axes_across(axis: Array) -> Array:
    """(3, 2) orthonormal columns across an axis (3,)."""
    return np.asarray(np.linalg.svd(axis[None])[2][1:].T)


@dataclass(frozen=True)
class YawSpread(Encoded):
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

    def fields_json(self) -> dict[str, object]:
        return {"sigma": self.sigma, "lever": self.lever or None, "corner_rms": self.corner if self.lever else None}


@dataclass(frozen=True)
class HeldPart:
    """A peg: its tip is the tool point, its body goes back along the tool axis."""

    length: float  # of what goes into the hole [m]
    axis: Vector  # (3,) unit vector of the tool axis, tool frame
    diameter: float = math.nan  # [m]
    friction: float = math.nan  # coefficient between peg and hole

    def behind(self, tip: ToolPoint) -> ToolPoint:
        """The top end of the peg whose tip is a tool point."""
        x, y, z = self.axis
        return tip.behind((-self.length * x, -self.length * y, -self.length * z))


@dataclass(frozen=True)
class TiltRisk:
    """An angle that the tilt of the peg must stay below."""

    angle: float  # [rad]
    probability: float  # that the tilt exceeds it


@dataclass(frozen=True)
class PegSpread(Encoded):
    """Lateral errors of the two ends of a peg and its tilt.

    Moved straight along the hole, the peg keeps its errors: the tip meets the mouth of the hole with its own, and when
    the peg is in, the axis passes the mouth with the error of the top end and the bottom with that of the tip.
    """

    part: HeldPart
    tip: Critical
    top: Critical
    covariance: Array  # (2 m, 2 m) of the lateral errors, the tip first [m²]
    tilt: Array  # (2, 2) covariance of the tilt of the axis about two axes across it [rad²]
    axis: Array  # (3,) nominal axis of the peg, world
    clearance: float  # radial [m], NaN without one

    @cached_property
    def p_success(self) -> JointProbability | None:
        """The probability that both ends stay within the clearance; None without a clearance."""
        if math.isnan(self.clearance):
            return None
        return both_within(self.covariance, self.clearance, np.concatenate([self.tip.bias, self.top.bias]))

    @property
    def success(self) -> float | None:
        return None if self.p_success is None else self.p_success.probability

    @property
    def tilt_sigma(self) -> float:
        """Largest standard deviation of the tilt [rad]."""
        return math.sqrt(max(float(np.linalg.eigvalsh(self.tilt)[-1]), 0.0))

    @property
    def two_point_contact(self) -> TiltRisk | None:
        """The tilt [rad] at which a peg that is all in touches the hole at both ends, ``2 clearance / length``."""
        return self._tilt_risk(2 * self.clearance / self.part.length)

    @property
    def wedging(self) -> TiltRisk | None:
        """The tilt beyond which two-point contact begins so early that friction can hold the peg, ``c / μ``.

        With ``c = 2 clearance / diameter``: contact begins at the depth ``2 clearance / tilt``; where that is less than
        ``μ diameter`` each contact lies in the friction cone of the other (D. E. Whitney, ASME J. Dynamic Systems,
        Measurement and Control 104 (1982) 65). None where diameter or friction are not stated.
        """
        return self._tilt_risk(2 * self.clearance / (self.part.friction * self.part.diameter))

    def _tilt_risk(self, angle: float) -> TiltRisk | None:
        return None if math.isnan(angle) else TiltRisk(angle, miss_probability(self.tilt, angle))

    def top_shift(self, shift: Array, rotation: Array) -> Array:
        """(N, 3) shift of the top end [m] by shifts (N, 3) of the tip and rotation vectors (N, 3) [rad], world."""
        return np.asarray(shift + turn_of(rotation, -self.part.length * self.axis))

    def fields_json(self) -> dict[str, object]:
        return {
            "length": self.part.length,
            "ends": [{"name": "tip", **self.tip.to_json()}, {"name": "top end", **self.top.to_json()}],
            "joint_covariance": self.covariance,
            "success_probability_error": self.p_success and self.p_success.error,
            **encoded(self, "tilt_sigma_max=tilt_sigma two_point_contact wedging"),
        }


def peg_spread(
    part: HeldPart, tip: ToolPoint, q: tuple[float, ...], of_tip: tuple[Critical, Array], clearance: float
) -> PegSpread:
    """Both ends of a peg at a posture; ``of_tip`` what counts of the tip's spread, and its basis (3, m)."""
    critical, basis = of_tip
    top = part.behind(tip)
    moments, moved = tip.moments(q), top.moments(q)
    C_tip, C_top = (np.asarray(found.covariance, dtype=float) for found in (moments, moved))
    at_top = Critical.of(critical.within, basis, C_top, np.asarray(moved.mean - moved.position, dtype=float))
    m, both = basis.shape[1], np.kron(np.eye(2), basis)
    lateral = both.T @ joint_covariance(tip, top, q, C_tip) @ both
    lateral[:m, :m] = critical.covariance
    axis = np.array(moments.walk.columns, dtype=float).T @ np.array(part.axis)
    across = axes_across(axis)
    tilt = across.T @ pose_covariance(tip, q, C_tip).covariance[3:, 3:] @ across
    return PegSpread(part, critical, at_top, lateral, tilt, axis, clearance)
