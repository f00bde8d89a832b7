"""Quantisation: a joint reaches whole steps only."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar, nearest_integer
from posture_opt.model.effects.base.cause import Abscissa, FittedSizes, Size
from posture_opt.model.effects.base.effect import Effect, Excitation
from posture_opt.model.effects.base.joint_effect import JointEffect
from posture_opt.numerics import TURN
from posture_opt.units import Angle, plus_minus, shown

_ENCODER_BITS = range(9, 17)  # Encoders that are tried: steps of a revolution over 2^bits
_DISPLAY_STEPS_DEG = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # Steps [deg] of rounded joint values that are tried


class Quantisation(JointEffect):
    """``dq = c (round(q / lsb) lsb − q)``, c near one, lsb the step of the encoder or of the controller's numbers
    [rad].
    """

    summary: ClassVar[str] = "the joint reaches discrete steps only"
    phrase: ClassVar[str] = "{target} is quantised: it reaches discrete steps only"
    measurement: ClassVar[str] = "log the joint values that the controller reached"
    inspection: ClassVar[str] = "encoder resolution of {target}; rounding of joint values in program or log"
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("share", "ratio"),)
    shape: ClassVar[tuple[str, ...]] = ("lsb",)
    shape_units: ClassVar[Mapping[str, str]] = {"lsb": "rad"}
    family: ClassVar[Literal["named", "steps", "periodic"]] = "periodic"
    limits: ClassVar[tuple[float, float]] = (0.4, 1.6)  # a step that is not taken whole is no rounding

    kind: Literal["quantisation"] = "quantisation"
    lsb: Angle = Field(gt=0, description="the step")

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(round(q/lsb) lsb − q,) [rad]."""
        steps = state.q[joint] / self.lsb
        return (self.lsb * (nearest_integer(steps) - steps),)

    @property
    def smooth_shape(self) -> str:
        """None: a step that differs by a little is another column altogether; the grid has the steps that are built."""
        return ""

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        return Abscissa.of(state, np.mod(np.asarray(state.q[self.index(state)]) / self.lsb, 1.0), "fraction of a step")

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The step [mrad], and the share of it that shows."""
        shows = plus_minus(*estimate.entry("share"))
        return Size("step", shown(self.lsb, "angle")), Size("share of it that shows", shows)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        sizes = [TURN / 2**bits for bits in _ENCODER_BITS] + [math.radians(d) for d in _DISPLAY_STEPS_DEG]
        return [cls(joint=name, lsb=f"{lsb!r} rad") for name in case.moving("revolute") for lsb in sizes]
