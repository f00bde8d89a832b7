"""A joint that turns with the temperature."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.effect import JointEffect


class ThermalOffset(JointEffect):
    """``dq = c (T − T0)``."""

    summary: ClassVar[str] = "the joint turns with the temperature"
    parameters: ClassVar = (("rate", "angle per temperature"),)
    needs: ClassVar = frozenset({"temperature"})

    kind: Literal["thermal_offset"] = "thermal_offset"

    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        return (site.inputs.temperature,)
