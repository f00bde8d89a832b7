"""Cyclic error of a joint with a period that nobody knows beforehand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.model.effects.cause import FittedSizes, Size
from posture_opt.model.effects.effect import Effect, Excitation
from posture_opt.model.effects.joint_effect import Harmonic
from posture_opt.units import number, plus_minus

FEWEST, MOST = 2.5, 300.0
"""Cycles per revolution that are searched; below lie eccentricity and second harmonic."""
_SLOW = 5.0  # cycles per revolution: below, it is one of the slow curves over its joint
OVERSAMPLING = 3.0  # of the spacing at which neighbouring frequencies are independent, 2π / range


class CyclicError(Harmonic):
    """``dq = a sin(k q) + b cos(k q)``, k cycles per revolution."""

    summary: ClassVar[str] = "joint error whose cycles per revolution are found from the data"
    measurement: ClassVar[str] = (
        "measure many values of {target} that lie on no regular grid, in postures that differ in all other joints"
    )
    rivals: ClassVar = {
        "gear_ripple": "measure many joint values that lie on no regular grid, and state 'gear_ratio'",
        "quantisation": "log the joint values that the controller reached, and measure many off any regular grid",
    }
    shape: ClassVar = ("cycles",)
    relative_shape: ClassVar[bool] = False
    family: ClassVar = "periodic"

    kind: Literal["cyclic_error"] = "cyclic_error"
    cycles: float = Field(gt=0, description="k, cycles per revolution of the joint")

    @property
    def frequency(self) -> float:
        return self.cycles

    @property
    def spectral_line(self) -> float:
        return self.cycles

    @property
    def slow(self) -> bool:  # type: ignore[override] # of this very instance
        return self.cycles < _SLOW

    @property
    def name(self) -> str:
        return f"{self.kind}({self.target} {self.cycles:.4g})"

    @property
    def words(self) -> str:
        return f"{self.joint} has a cyclic error of {number(self.cycles, 4)} cycles per revolution"

    @property
    def qualifier(self) -> str:
        return f"{number(self.cycles, 4)} cycles per revolution"

    @property
    def exclusive(self) -> tuple[object, ...]:
        return self.kind, self.target, round(self.cycles, 1)  # one joint may have several lines

    def bracket(self, span: float) -> tuple[float, float]:
        step = 2 * math.pi / span / OVERSAMPLING
        return self.cycles - step, self.cycles + step

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        value, std = estimate.entry("cycles")
        cycles = plus_minus(value, std) if math.isfinite(std) else number(value, 4)
        return (*super().sizes(estimate), Size("cycles per revolution", cycles))

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        return []  # thousands: the diagnosis scans the grid by itself

    @classmethod
    def grid(cls, span: float) -> np.ndarray:
        """Cycles per revolution [1] to search where the joint ranges over ``span`` [rad]."""
        step = 2 * math.pi / max(span, 1e-3) / OVERSAMPLING
        # Half a period must fit the range of the joint: what is longer is no cycle but a curve.
        first = max(FEWEST, math.pi / max(span, 1e-3))
        return np.arange(first, MOST, step)
