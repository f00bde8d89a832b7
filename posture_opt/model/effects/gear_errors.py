"""Errors of a gear or an encoder disc: one and two cycles per revolution, ripple at multiples of the ratio."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.model.arm_state import ArmState
from posture_opt.model.effects.base.cause import Abscissa, Input, over_joint
from posture_opt.model.effects.base.effect import Effect, Excitation
from posture_opt.model.effects.base.joint_effect import Harmonic
from posture_opt.model.effects.base.multiples import cycles_text


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


class GearRipple(Harmonic):
    """``dq = a sin(n N q) + b cos(n N q)``, N the gear ratio and n the harmonic; amplitude ``√(a² + b²)`` [rad]."""

    summary: ClassVar[str] = "joint error once or twice per revolution of the motor; needs the gear ratio"
    phrase: ClassVar[str] = "the gear of {target} has ripple at its input shaft"
    measurement: ClassVar[str] = "measure many joint values that lie on no regular grid"
    inspection: ClassVar[str] = (
        "input side of the gear of {target}: wave generator or pinion, motor shaft and motor encoder"
    )
    rivals: ClassVar[Mapping[str, str]] = {
        "quantisation": "log the joint values that the controller reached, and state 'gear_ratio'"
    }
    needs: ClassVar[frozenset[Input]] = frozenset({"gear_ratio"})

    kind: Literal["gear_ripple"] = "gear_ripple"
    ratio: float = Field(description="N, motor revolutions per revolution of the joint")
    harmonic: int = Field(1, ge=1, description="n, cycles per revolution of the motor")

    @property
    def frequency(self) -> float:
        """n N, cycles per revolution of the joint."""
        return self.harmonic * self.ratio

    @property
    def spectral_lines(self) -> tuple[float, ...]:
        return (self.frequency,)

    @property
    def qualifier(self) -> str:
        return f"{cycles_text(self.frequency)} cycles per revolution"

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        ratios = {j.name: abs(j.gear_ratio) for j in case.robot.joints if math.isfinite(j.gear_ratio)}
        moving = [name for name in case.moving("revolute") if ratios.get(name, 0.0) > 2]
        return [cls(joint=name, ratio=ratios[name], harmonic=n) for name in moving for n in (1, 2)]
