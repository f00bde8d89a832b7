"""``PegSpread``: a peg placed and tilted by its tool: the probability at both ends, contact and wedging."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.numerics import Array, Json, finite_or_none
from posture_opt.uncertainty.moments.pose_covariance import pose_covariance
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.moments.two_points import JointProbability, both_within, joint_covariance
from posture_opt.uncertainty.regions.clearance import miss_probability
from posture_opt.uncertainty.regions.critical import Critical
from posture_opt.uncertainty.spread.held_part import HeldPart


@dataclass(frozen=True)
class TiltRisk:
    """An angle that the tilt of the peg must stay below.

    Args:
        angle: [rad].
        probability: that the tilt exceeds it.
    """

    angle: float
    probability: float


@dataclass(frozen=True)
class PegSpread:
    """Lateral errors of the two ends of a peg and its tilt.

    Moved straight along the hole, the peg keeps its errors: the tip meets the mouth of the hole with its own, and when
    the peg is in, the axis passes the mouth with the error of the top end and the bottom with that of the tip.

    Args:
        tip, top: what counts of the spread of each end.
        covariance: (2 m, 2 m) of the lateral errors, the tip first [m²].
        tilt: (2, 2) covariance of the tilt of the axis about two axes across it [rad²].
        axis: (3,) nominal axis of the peg, world.
        clearance: radial [m], NaN without one.
    """

    part: HeldPart
    tip: Critical
    top: Critical
    covariance: Array
    tilt: Array
    axis: Array
    clearance: float

    @cached_property
    def p_success(self) -> JointProbability | None:
        """The probability that both ends stay within the clearance, with its error by integration; None without a
        clearance.
        """
        if math.isnan(self.clearance):
            return None
        return both_within(self.covariance, self.clearance, np.concatenate([self.tip.bias, self.top.bias]))

    @property
    def success(self) -> float | None:
        """The probability that both ends stay within the clearance; None without a clearance."""
        return None if self.p_success is None else self.p_success.probability

    @property
    def tilt_sigma(self) -> float:
        """Largest standard deviation of the tilt [rad]."""
        return math.sqrt(max(float(np.linalg.eigvalsh(self.tilt)[-1]), 0.0))

    @property
    def two_point_contact(self) -> TiltRisk | None:
        """The tilt [rad] at which a peg that is in all the way touches the hole at both ends, ``2 clearance /
        length``.
        """
        return None if math.isnan(self.clearance) else self._tilt_risk(2 * self.clearance / self.part.length)

    @property
    def wedging(self) -> TiltRisk | None:
        """The tilt beyond which two-point contact begins so early that friction can hold the peg, ``c / μ``.

        With ``c = 2 clearance / diameter``: contact begins at the depth ``2 clearance / tilt``; where that is less than
        ``μ diameter`` each contact lies in the friction cone of the other (D. E. Whitney, ASME J. Dynamic Systems,
        Measurement and Control 104 (1982) 65). None where diameter or friction are not stated.
        """
        if math.isnan(self.clearance) or math.isnan(self.part.friction):
            return None
        return self._tilt_risk(2 * self.clearance / (self.part.friction * self.part.diameter))

    def _tilt_risk(self, angle: float) -> TiltRisk:
        """The probability that the tilt exceeds an angle [rad]."""
        return TiltRisk(angle, miss_probability(self.tilt, angle))

    def top_shift(self, shift: Array, rotation: Array) -> Array:
        """(N, 3) shift of the top end [m] by shifts (N, 3) of the tip and rotation vectors (N, 3) [rad], world."""
        lever = -self.part.length * self.axis
        angle = np.linalg.norm(rotation, axis=1, keepdims=True)
        unit = np.divide(rotation, angle, out=np.zeros_like(rotation), where=angle > 0)
        first = np.cross(unit, lever)
        # Rodrigues' formula, R v - v without cancellation.
        turned = np.sin(angle) * first + 2 * np.sin(angle / 2) ** 2 * np.cross(unit, first)
        return np.asarray(shift + turned)

    def to_json(self) -> dict[str, Json]:
        """Plain numbers, SI."""
        ends = [{"name": name, **end.to_json()} for name, end in (("tip", self.tip), ("top end", self.top))]
        risks = {"two_point_contact": self.two_point_contact, "wedging": self.wedging}
        return {
            "length": self.part.length,
            "ends": ends,
            "joint_covariance": self.covariance.tolist(),
            "success_probability_error": None if self.p_success is None else finite_or_none(self.p_success.error),
            "tilt_sigma_max": self.tilt_sigma,
            **{name: None if risk is None else vars(risk) for name, risk in risks.items()},
        }


def peg_spread(
    part: HeldPart, tip: ToolPoint, q: tuple[float, ...], of_tip: tuple[Critical, Array], clearance: float
) -> PegSpread:
    """Both ends of a peg at a posture.

    Args:
        part: the peg.
        tip: the tool point, which is its tip.
        q: (n,) posture [rad or m].
        of_tip: what counts of the spread of the tip, and the basis (3, m) that it is seen in.
        clearance: radial [m], NaN without one.
    """
    critical, basis = of_tip
    top = part.behind(tip)
    moments, moved = tip.moments(q), top.moments(q)
    C_tip, C_top = (np.asarray(found.covariance, dtype=float) for found in (moments, moved))
    at_top = Critical.of(critical.within, basis, C_top, np.asarray(moved.mean - moved.position, dtype=float))
    m, joint = basis.shape[1], joint_covariance(tip, top, q, C_tip)
    both = np.kron(np.eye(2), basis)
    lateral = both.T @ joint @ both
    lateral[:m, :m] = critical.covariance
    R = np.array(moments.walk.columns, dtype=float).T
    axis = R @ np.array(part.axis)
    across = np.linalg.svd(axis[None])[2][1:].T
    tilt = across.T @ pose_covariance(tip, q, C_tip).covariance[3:, 3:] @ across
    return PegSpread(part, critical, at_top, lateral, tilt, axis, clearance)
