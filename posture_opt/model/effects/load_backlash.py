"""Lost motion that grows with the load of the joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np

from posture_opt.model.arm_state import MIN_LEANING_SINE, ArmState
from posture_opt.model.chain import Scalar, magnitude
from posture_opt.model.effects.base.cause import Abscissa, Input
from posture_opt.model.effects.base.joint_effect import LostMotion


class LoadBacklash(LostMotion):
    """``dq = −h s |τ|``, τ the torque of gravity [N m], h in rad/(N m); h > 0 stops short (see `LostMotion`)."""

    summary: ClassVar[str] = "backlash in proportion to the load of the joint, as of friction"
    phrase: ClassVar[str] = "{target} stops short of its command in proportion to its load"
    measurement: ClassVar[str] = "approach each posture from both sides under two payloads"
    inspection: ClassVar[str] = "bearing preload, gear mesh and clamp screws of {target} under load; its counterbalance"
    rivals: ClassVar[Mapping[str, str]] = {
        "hysteresis": "approach from both sides, after short and long moves, under two payloads"
    }
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("height", "angle per torque"),)
    needs: ClassVar[frozenset[Input]] = frozenset({"approach", "masses"})

    kind: Literal["load_backlash"] = "load_backlash"

    def acts(self, state: ArmState) -> bool:
        return state.leaning(self.index(state)) > MIN_LEANING_SINE

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """``(−s |τ|,)`` [N m]; 0 where the side is not known."""
        return (self.lag(state, joint) * magnitude(state.torque(joint)),)

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """The size of the torque [N m], with the sign of the side."""
        joint = self.index(state)
        torque = np.sign(state.inputs.side(joint)) * np.abs(state.torque(joint))
        return Abscissa.of(state, torque, f"torque on {self.joint} [N m], with the sign of the side of approach")
