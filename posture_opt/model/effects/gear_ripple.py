"""Ripple of a gear at multiples of its ratio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.effect import Effect, Excitation, JointEffect
from posture_opt.model.scalars import cos, sin


class GearRipple(JointEffect):
    """``dq = a sin(n N q) + b cos(n N q)``, N the gear ratio and n the harmonic."""

    summary: ClassVar[str] = "joint error at the period of the motor, or half of it; needs the gear ratio"
    parameters: ClassVar = (("sin", "angle"), ("cos", "angle"))
    needs: ClassVar = frozenset({"gear_ratio"})

    kind: Literal["gear_ripple"] = "gear_ripple"
    ratio: float = Field(description="N, motor turns a turn of the joint")
    harmonic: int = Field(1, ge=1, description="n, periods a turn of the motor")

    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        angle = self.harmonic * self.ratio * site.q[joint]
        return sin(angle), cos(angle)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        ratios = {j.name: abs(j.gear_ratio) for j in case.robot.joints if math.isfinite(j.gear_ratio)}
        moving = [name for name in case.moving("revolute") if ratios.get(name, 0.0) > 2]
        return [cls(joint=name, ratio=ratios[name], harmonic=n) for name in moving for n in (1, 2)]
