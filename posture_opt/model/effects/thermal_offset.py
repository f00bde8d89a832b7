"""A joint that turns with the temperature."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.base.cause import Abscissa, Input
from posture_opt.model.effects.base.joint_effect import JointEffect
from posture_opt.model.effects.base.plausible_range import PlausibleRange
from posture_opt.robot.robot import Robot

_LARGEST_RATE = 1e-4  # rad/K: four times the expansion of aluminium


class ThermalOffset(JointEffect):
    """``dq = c (T − T0)``: the zero of the joint moves by c [rad/K]; T0 = 20 degC (ISO 1)."""

    summary: ClassVar[str] = "the zero of the joint drifts with temperature"
    phrase: ClassVar[str] = "the zero of {target} drifts with temperature"
    measurement: ClassVar[str] = "log the temperature through a warm-up and a cool-down"
    inspection: ClassVar[str] = "what heats {target}: motor, brake and gear; how its encoder is fastened"
    rivals: ClassVar[Mapping[str, str]] = {
        "drift": "log the temperature through a warm-up and a cool-down: time only grows"
    }
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("rate", "angle per temperature"),)
    needs: ClassVar[frozenset[Input]] = frozenset({"temperature"})

    kind: Literal["thermal_offset"] = "thermal_offset"

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(T − T0,) [K]."""
        return (state.inputs.temperature,)

    def plausible(self, robot: Robot) -> PlausibleRange | None:
        """Up to 100 µrad/K: the expansion of aluminium, 23 ppm/K, of a housing four times as long as it is wide."""
        needs = "a housing that is bent by heat more than its expansion can bend it"
        source = "Kaye, Laby, Tables of Physical and Chemical Constants"
        return PlausibleRange(-_LARGEST_RATE, _LARGEST_RATE, "angle per temperature", needs, source)

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """The temperature above 20 degC [K]."""
        return Abscissa.of(state, state.inputs.temperature, "temperature above 20 degC [K]")
