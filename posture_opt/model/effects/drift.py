"""Drift of the measured point with time, the same in all postures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

from pydantic import Field

from posture_opt.model.arm_state import ZERO, ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.effect import Effect, Excitation, Sensitivity
from posture_opt.model.scalars import exp
from posture_opt.units import Time

_GRID = (0.03, 0.06, 0.12, 0.25, 0.5)  # of the duration; slower than half of it an exponential is a line


class Drift(Effect):
    """``dp = v (1 − exp(−t / τ))`` (exponential) or ``dp = v t / t_end`` (linear, v the shift at the end)."""

    summary: ClassVar[str] = "the point moves with time, the same in all postures"
    parameters: ClassVar = (("x", "length"), ("y", "length"), ("z", "length"))
    shape: ClassVar = ("constant",)
    shape_units: ClassVar = {"constant": "s"}
    needs: ClassVar = frozenset({"time"})
    for_planning: ClassVar = False

    kind: Literal["drift"] = "drift"
    course: Literal["exponential", "linear"] = "linear"
    constant: Time = Field(gt=0, description="τ of an exponential drift, duration of a linear one")

    @property
    def target(self) -> str:
        return self.course

    def moves(self, site: ArmState) -> tuple[Sensitivity, ...]:
        t = site.inputs.time / self.constant
        size: Scalar = t if self.course == "linear" else 1 - exp(-t)
        return tuple(Sensitivity(twist=(_along(axis, size), ZERO)) for axis in range(3))

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        if not cls.needs <= case.inputs or case.duration <= 0:
            return []
        curves = [cls(course="exponential", constant=_seconds(f * case.duration)) for f in _GRID]
        return [cls(course="linear", constant=_seconds(case.duration)), *curves]


def _seconds(value: float) -> Any:
    return f"{value!r} s"


def _along(axis: int, size: Scalar) -> Any:
    vector: list[Scalar] = [0.0, 0.0, 0.0]
    vector[axis] = size
    return tuple(vector)
