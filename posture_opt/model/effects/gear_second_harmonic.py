"""Second harmonic of a gear or an encoder disc: two cycles per revolution."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.effects.base.cause import Abscissa, over_joint
from posture_opt.model.effects.base.joint_effect import Harmonic


class GearSecondHarmonic(Harmonic):
    """``dq = a sin 2q + b cos 2q``: two cycles per revolution, amplitude ``√(a² + b²)`` [rad]."""

    summary: ClassVar[str] = "joint error of two cycles per revolution, as of an oval or tilted disc"
    phrase: ClassVar[str] = "{target} has a second harmonic (two cycles per revolution), as of an oval gear"
    measurement: ClassVar[str] = "drive {target} through a whole revolution, as far as stops, cables and cell permit"
    inspection: ClassVar[str] = "gear and encoder disc of {target}: oval, tilted, or unevenly tightened"
    slow: ClassVar[bool] = True

    kind: Literal["gear_second_harmonic"] = "gear_second_harmonic"

    @property
    def frequency(self) -> float:
        """2 cycles per revolution."""
        return 2.0

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """The joint value [deg]."""
        return over_joint(state, self.index(state))
