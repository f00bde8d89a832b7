"""A reading that belongs to another moment than its row: an error in proportion to the speed of the arm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.effects.base.cause import Input
from posture_opt.model.effects.base.effect import Sensitivity, SoleEffect


class LateReading(SoleEffect):
    """``dq = −t dq/dt`` of all joints: what is read is where the tool was a time t before, or the arm lags by it.

    A static row has none of it, nor has a task: an arm that is learned on a moving path without it is wrong elsewhere.
    """

    summary: ClassVar[str] = "an instrument that reads a moving arm too late, or joints that lag behind their commands"
    phrase: ClassVar[str] = "errors grow with the speed of the arm: readings and joint values are of different moments"
    measurement: ClassVar[str] = "measure the same path slowly and fast, or stop at each posture"
    inspection: ClassVar[str] = "trigger and clock of the instrument against those of the controller"
    rivals: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("hysteresis", "backlash", "joint_coupling"), "measure the same path slowly: lost motion does not need speed"
    )
    sole: ClassVar[str] = "instrument"
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("delay", "time"),)
    needs: ClassVar[frozenset[Input]] = frozenset({"speed"})

    kind: Literal["late_reading"] = "late_reading"

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """The way of every joint in the opposite direction [rad/s or m/s], for the parameter ``delay``."""
        return (Sensitivity({i: -speed for i, speed in enumerate(state.inputs.speed)}),)
