"""Hysteresis: lost motion that grows with the length of the last move."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar, exp
from posture_opt.model.effects.base.cause import Abscissa, FittedSizes, Size
from posture_opt.model.effects.base.effect import Effect, Excitation
from posture_opt.model.effects.base.joint_effect import LostMotion
from posture_opt.units import Angle, plus_minus

# Travels d0 [rad] that are tried: from 1 to 90 degrees, by factors of about two
_TRAVEL_GRID_RAD = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.5)


class Hysteresis(LostMotion):
    """``dq = −h s (1 − exp(−d / d0))``, d the length of the last move [rad].

    h [rad] is reached after long moves; h > 0 stops short (see `LostMotion`).
    """

    summary: ClassVar[str] = "lost motion that grows with the length of the last move"
    phrase: ClassVar[str] = "{target} has hysteresis: it stops short of its command, more so after long moves"
    measurement: ClassVar[str] = "approach each posture from both sides after short moves and after long ones"
    inspection: ClassVar[str] = "friction in {target}: seals, lubrication and bearing preload, a belt if it has one"
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("height", "angle"),)
    shape: ClassVar[tuple[str, ...]] = ("travel",)
    shape_units: ClassVar[Mapping[str, str]] = {"travel": "rad"}

    kind: Literal["hysteresis"] = "hysteresis"
    travel: Angle = Field(gt=0, description="d0, travel after which 63 % is reached")

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(−s (1 − exp(−d/d0)),) for the parameter ``height`` [rad]."""
        return (self.lag(state, joint) * (1 - exp(-state.inputs.travel(joint) / self.travel)),)

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """Length of the last move [deg], with the sign of its side."""
        joint = self.index(state)
        move = np.sign(state.inputs.side(joint)) * np.degrees(state.inputs.travel(joint))
        return Abscissa.of(state, move, f"last move of {self.joint} [deg]")

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The height and the travel d0 [deg]."""
        travel = plus_minus(*estimate.entry("travel"), math.degrees(1.0), "deg")
        return (*super().sizes(estimate), Size("63 % reached after", f"a move of {travel}"))

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        if not cls.needs <= case.inputs:
            return []
        return [cls(joint=name, travel=f"{d} rad") for name in case.moving("revolute") for d in _TRAVEL_GRID_RAD]
