"""Eccentricity of a gear or an encoder disc: one period a turn."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.effect import JointEffect
from posture_opt.model.scalars import cos, sin


class GearEccentricity(JointEffect):
    """``dq = a sin q + b cos q``."""

    summary: ClassVar[str] = "one period of joint error a turn, as of an eccentric gear or encoder disc"
    parameters: ClassVar = (("sin", "angle"), ("cos", "angle"))

    kind: Literal["gear_eccentricity"] = "gear_eccentricity"

    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        return sin(site.q[joint]), cos(site.q[joint])
