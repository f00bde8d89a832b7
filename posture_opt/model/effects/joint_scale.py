"""Scale of a joint: its encoder counts a turn as a little more or less."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.effect import JointEffect


class JointScale(JointEffect):
    """``dq = c q``."""

    summary: ClassVar[str] = "the joint moves by a factor more than commanded"
    parameters: ClassVar = (("scale", "ratio"),)
    types: ClassVar = ("revolute", "prismatic")

    kind: Literal["joint_scale"] = "joint_scale"

    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        return (site.q[joint],)
