"""Cyclic error of a joint with a period that nobody knows beforehand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.effect import Effect, Excitation, JointEffect
from posture_opt.model.scalars import cos, sin

FEWEST, MOST = 2.5, 300.0
"""Cycles a turn that are searched; below lie eccentricity and second harmonic."""
OVERSAMPLING = 3.0  # of the spacing at which neighbouring frequencies are independent, 2π / range


class CyclicError(JointEffect):
    """``dq = a sin(k q) + b cos(k q)``, k cycles a turn."""

    summary: ClassVar[str] = "joint error with a number of cycles a turn that the data tell"
    parameters: ClassVar = (("sin", "angle"), ("cos", "angle"))
    shape: ClassVar = ("cycles",)
    family: ClassVar = "periodic"

    kind: Literal["cyclic_error"] = "cyclic_error"
    cycles: float = Field(gt=0, description="k, periods a turn of the joint")

    @property
    def exclusive(self) -> tuple[object, ...]:
        """Lines of one joint are effects by themselves unless they are the same line."""
        return self.kind, self.joint, round(self.cycles, 1)

    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        angle = self.cycles * site.q[joint]
        return sin(angle), cos(angle)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        return []  # thousands: the diagnosis scans the grid by itself

    @classmethod
    def grid(cls, span: float) -> np.ndarray:
        """Cycles a turn [1] to search where the joint ranges over ``span`` [rad]."""
        step = 2 * math.pi / max(span, 1e-3) / OVERSAMPLING
        # Half a period must fit the range of the joint: what is longer is no cycle but a curve.
        first = max(FEWEST, math.pi / max(span, 1e-3))
        return np.arange(first, MOST, step)
