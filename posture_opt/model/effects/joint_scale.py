"""Scale error of a joint: its encoder counts a revolution as a little more or less."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.base.cause import Abscissa, over_joint
from posture_opt.model.effects.base.joint_effect import JointEffect


class JointScale(JointEffect):
    """``dq = c q``: the joint moves by the factor ``1 + c`` of what is commanded, from its zero."""

    summary: ClassVar[str] = "the joint moves by a constant factor more or less than commanded"
    phrase: ClassVar[str] = "{target} has a scale error"
    measurement: ClassVar[str] = "drive {target} through its whole range"
    inspection: ClassVar[str] = (
        "gear ratio and encoder counts of {target} as set in the controller; a belt or coupling that slips"
    )
    rivals: ClassVar[Mapping[str, str]] = {
        "gear_eccentricity": "drive {target} through its whole range: a scale error grows linearly, an eccentricity "
        "is periodic",
        "gear_second_harmonic": "drive {target} through its whole range: a scale error grows linearly, a harmonic is "
        "periodic",
    }
    slow: ClassVar[bool] = True
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("scale", "ratio"),)
    types: ClassVar[tuple[str, ...]] = ("revolute", "prismatic")

    kind: Literal["joint_scale"] = "joint_scale"

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(q,) [rad or m]."""
        return (state.q[joint],)

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """The joint value [deg or mm]."""
        return over_joint(state, self.index(state))
