"""Backlash: the joint value depends on the side from which it was reached."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.base.catalogue_entry import Input
from posture_opt.model.effects.base.cause import Abscissa, over_joint
from posture_opt.model.effects.base.effect import NOT_NEGATIVE
from posture_opt.model.effects.base.joint_effect import JointEffect


class Backlash(JointEffect):
    """``dq = b s / 2``, s the side from which the joint arrived: +1 with increasing values, −1 with decreasing ones.

    The two sides are b [rad] apart. Where s is not known it is 0, and the effect is not seen.
    """

    summary: ClassVar[str] = "lost motion: the joint value depends on the side from which it was reached"
    phrase: ClassVar[str] = "{target} has backlash"
    measurement: ClassVar[str] = "approach each posture from both sides, in random order"
    rivals: ClassVar[Mapping[str, str]] = {
        "hysteresis": "approach from both sides after short moves and after long ones: backlash is constant, "
        "hysteresis grows with the move",
        "load_backlash": "approach from both sides under two payloads",
    }
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("width", "angle"),)
    limits: ClassVar[tuple[float, float]] = NOT_NEGATIVE
    needs: ClassVar[frozenset[Input]] = frozenset({"approach"})

    kind: Literal["backlash"] = "backlash"

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(s/2,) for the parameter ``width`` [rad]; 0 where the side is not known."""
        return (state.inputs.side(joint) / 2,)

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """The joint value [deg or mm], a curve for each side."""
        joint = self.index(state)
        return over_joint(state, joint, ", by side of approach", np.sign(state.inputs.side(joint)))
