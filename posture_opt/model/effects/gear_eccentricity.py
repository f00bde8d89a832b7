"""Eccentricity of a gear or an encoder disc: one cycle per revolution."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.effects.base.cause import Abscissa, over_joint
from posture_opt.model.effects.base.joint_effect import Harmonic


class GearEccentricity(Harmonic):
    """``dq = a sin q + b cos q``: one cycle per revolution, amplitude ``√(a² + b²)`` [rad]."""

    summary: ClassVar[str] = "joint error of one cycle per revolution, as of an eccentric gear or encoder disc"
    phrase: ClassVar[str] = "{target} has an eccentric gear or encoder (one cycle per revolution)"
    measurement: ClassVar[str] = (
        "drive {target} through a whole revolution, as far as stops, cables and cell permit, under two payloads"
    )
    inspection: ClassVar[str] = (
        "run-out of the output gear and bearing of {target}; screws and centring of its encoder disc"
    )
    rivals: ClassVar[Mapping[str, str]] = {
        "gear_second_harmonic": "drive {target} through a whole revolution, as far as stops, cables and cell permit: "
        "on part of it, one cycle looks like two"
    }
    slow: ClassVar[bool] = True

    kind: Literal["gear_eccentricity"] = "gear_eccentricity"

    @property
    def frequency(self) -> float:
        """1 cycle per revolution."""
        return 1.0

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """The joint value [deg]; over its phase it would look the same."""
        return over_joint(state, self.index(state))
