"""Backlash: the joint value depends on the side from which it was reached."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.base.cause import Abscissa, FittedSizes, Size, over_joint
from posture_opt.model.effects.base.joint_effect import LostMotion

_WHOLE = "whole width"  # What the size of a play is: drawings state it so, others its half to either side


class Backlash(LostMotion):
    """``dq = −b s / 2``: both directions of approach end b [rad] apart; b > 0 stops short (see `LostMotion`)."""

    summary: ClassVar[str] = "lost motion: the joint stops short of its command, by half a width from either direction"
    phrase: ClassVar[str] = "{target} has backlash and stops short of its command"
    measurement: ClassVar[str] = "approach each posture from both sides, in random order"
    inspection: ClassVar[str] = (
        "free play of {target} by hand against a dial gauge, brake released, drive holding; gear mesh, couplings "
        "between motor and joint, a belt if it has one"
    )
    rivals: ClassVar[Mapping[str, str]] = {
        "hysteresis": "approach from both sides after short moves and after long ones: backlash is constant, "
        "hysteresis grows with the move",
        "load_backlash": "approach from both sides under two payloads",
    }
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("width", "angle"),)

    kind: Literal["backlash"] = "backlash"

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(−s/2,) for the parameter ``width`` [rad]; 0 where the side is not known."""
        return (self.lag(state, joint) / 2,)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The width b: the whole distance between both directions of approach."""
        return tuple(replace(size, more=f"{size.more}, {_WHOLE}") for size in super().sizes(estimate))

    def headline(self, estimate: FittedSizes) -> str:
        return f"{super().headline(estimate)} {_WHOLE}"

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """The joint value [deg or mm], a curve for each side."""
        joint = self.index(state)
        return over_joint(state, joint, ", by side of approach", np.sign(state.inputs.side(joint)))
