"""Drift of the measured point with time, the same in all postures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import ZERO, Scalar, exp
from posture_opt.model.effects.base.catalogue_entry import Input
from posture_opt.model.effects.base.cause import Abscissa, FittedSizes, Size, over_time
from posture_opt.model.effects.base.effect import Effect, Excitation, Sensitivity
from posture_opt.units import Time, plus_minus, shown

_CONSTANT_SHARES = (0.03, 0.06, 0.12, 0.25, 0.5)
"""Time constants that are tried, of the duration; slower than half of it an exponential is a line."""


class Drift(Effect):
    """``dp = v (1 − exp(−t / τ))`` (exponential) or ``dp = v t / t_end`` (linear, v the shift at the end).

    v (3,) [m], world axes; t [s] since the first measurement, or the number of the row where no times are logged.
    """

    summary: ClassVar[str] = "the measured point drifts with time, the same in all postures"
    phrase: ClassVar[str] = "the measured point drifts with time ({target})"
    measurement: ClassVar[str] = "return to a reference target every few postures, and take the others in random order"
    inspection: ClassVar[str] = (
        "warm-up of arm and instrument, clamping of tool and reflector, and the stand of the instrument"
    )
    rivals: ClassVar[Mapping[str, str]] = {
        "slip": "return to the same few postures again and again: a drift is gradual, a slip is a step",
        "instrument_field": "repeat the postures in another order, so that position and time are independent",
    }
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("x", "length"), ("y", "length"), ("z", "length"))
    shape: ClassVar[tuple[str, ...]] = ("constant",)
    shape_units: ClassVar[Mapping[str, str]] = {"constant": "s"}
    needs: ClassVar[frozenset[Input]] = frozenset({"time"})
    for_planning: ClassVar[bool] = False

    kind: Literal["drift"] = "drift"
    course: Literal["exponential", "linear"] = Field("linear", description="of the shift over time")
    constant: Time = Field(gt=0, description="τ of an exponential drift, duration of a linear one")

    @property
    def target(self) -> str:
        """The course: ``exponential`` or ``linear``."""
        return self.course

    @property
    def smooth_shape(self) -> str:
        """The time constant of an exponential drift; a linear one has no shape to fit."""
        return "constant" if self.course == "exponential" else ""

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """Time [min], or the row."""
        return over_time(state, timed)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """Length of the shift [µm] with its standard error, and the time constant of an exponential drift."""
        shift, std = _vector_length([estimate.entry(axis) for axis in "xyz"])
        sizes = (Size("shift", plus_minus(shift, std, 1e6, "µm"), " at the end"),)
        if self.course == "linear":
            return sizes
        constant = estimate.entry("constant")
        if estimate.timed:
            return (*sizes, Size("time constant", shown(constant[0], "time", constant[1])))
        return (*sizes, Size("time constant", plus_minus(*constant, 1.0, "rows"), ", as no times are logged"))

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """A shift (3,) along each world axis, times ``1 − exp(−t/τ)`` or ``t/t_end``."""
        t = state.inputs.time / self.constant
        size: Scalar = t if self.course == "linear" else 1 - exp(-t)
        return tuple(Sensitivity(twist=(_axis_vector(axis, size), ZERO)) for axis in range(3))

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        """A linear drift and exponential ones on the grid of time constants, where times are known."""
        if not cls.needs <= case.inputs or case.duration <= 0:
            return []
        curves = [cls(course="exponential", constant=_seconds_text(f * case.duration)) for f in _CONSTANT_SHARES]
        return [cls(course="linear", constant=_seconds_text(case.duration)), *curves]


def _seconds_text(value: float) -> Scalar:
    """A time as the text that the field reads, to the last digit."""
    return f"{value!r} s"


def _vector_length(parts: list[tuple[float, float]]) -> tuple[float, float]:
    """Length of a vector and its standard error, from components (value, standard error) taken as independent."""
    size = math.hypot(*(value for value, _ in parts))
    return size, math.hypot(*(value * std for value, std in parts)) / size if size else math.nan


def _axis_vector(axis: int, size: Scalar) -> Scalar:
    """(3,) a world axis times a size."""
    vector: list[Scalar] = [0.0, 0.0, 0.0]
    vector[axis] = size
    return tuple(vector)
