"""Second harmonic of a gear or an encoder disc: two periods a turn."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.effect import JointEffect
from posture_opt.model.scalars import cos, sin


class GearSecondHarmonic(JointEffect):
    """``dq = a sin 2q + b cos 2q``."""

    summary: ClassVar[str] = "two periods of joint error a turn, as of an oval or tilted disc"
    parameters: ClassVar = (("sin", "angle"), ("cos", "angle"))

    kind: Literal["gear_second_harmonic"] = "gear_second_harmonic"

    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        return sin(2 * site.q[joint]), cos(2 * site.q[joint])
