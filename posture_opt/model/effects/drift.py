"""Drift with time: of the measured point, the same in all postures, or of the base, which turns too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar, exp
from posture_opt.model.effects.base.cause import Abscissa, FittedSizes, Input, Size, over_time
from posture_opt.model.effects.base.effect import (
    ANGLES,
    WORLD_AXES,
    Effect,
    Excitation,
    Sensitivity,
    foot,
    frame_motion,
)
from posture_opt.units import Time, plus_minus, shown

# Time constants that are tried, of the duration; slower than half of it an exponential is a line
_CONSTANT_SHARES = (0.03, 0.06, 0.12, 0.25, 0.5)


class Drift(Effect):
    """``dp = v (1 − exp(−t / τ))`` (exponential), ``v exp(−t / τ)`` (settling) or ``v t / t_end`` (linear).

    v (3,) [m], world axes; t [s] since the first measurement, or the number of the row where no times are logged.
    A base that drifts turns too, about the foot of the first joint, ``dp = s(t) (v + w × r)``, w (3,) [rad]; the stand
    of an instrument that turns so shows alike.
    An exponential drift leaves the place of the first row, one that is settling comes to where the file says: where the
    base is free, both are the same.
    """

    summary: ClassVar[str] = "the measured point drifts with time, alike in all postures; or the base, which turns too"
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
    course: Literal["exponential", "linear", "settling"] = Field("linear", description="of the shift over time")
    of: Literal["point", "base"] = Field("point", description="what drifts: the measured point, or the base, and turns")
    constant: Time = Field(gt=0, description="τ of an exponential or settling drift, duration of a linear one")

    @property
    def target(self) -> str:
        """The course, ``exponential``, ``linear`` or ``settling``; ``base`` where that drifts."""
        return self.course if self.of == "point" else self.of

    @property
    def dimensions(self) -> tuple[tuple[str, str], ...]:
        """The shift; of a base its turn too."""
        return self.parameters if self.of == "point" else (*self.parameters, *((name, "angle") for name in ANGLES))

    @property
    def exclusive(self) -> tuple[object, ...]:
        """Drifts that end are shapes of one: where it starts or where it ends may be where the file says."""
        return self.kind, self.course == "linear"

    @property
    def words(self) -> str:
        """The cause in one clause; of a settling drift, that the first rows are off."""
        if self.course == "settling":
            return "the measured point is off at first, and settles with time"
        return "the base, or the stand of the instrument, turns with time" if self.of == "base" else super().words

    @property
    def less_likely(self) -> bool:
        """A drift that is settling: where geometry hides which place is right, all folds are to choose one course. And
        one of a base, which shifts as the point does where it does not turn."""
        return self.course == "settling" or self.of == "base"

    def worded(self, estimate: FittedSizes) -> str:
        if self.course == "linear":
            return self.words
        what = (
            "the base, or the stand of the instrument, turns, and settles"
            if self.of == "base"
            else (
                "the first rows are off, and the measured point settles"
                if self.course == "settling"
                else "the measured point drifts, and settles"
            )
        )
        return f"{what} within {_settling(estimate)}"

    @property
    def smooth_shape(self) -> str:
        """The time constant of a drift that ends; a linear one has no shape to fit."""
        return "" if self.course == "linear" else "constant"

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa:
        """Time [min], or the row."""
        return over_time(state, timed)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """Angle of the turn, length of the shift [µm]; when a drift that ends has done so."""
        shift, std = estimate.length("xyz")
        linear = self.course == "linear"
        between = " from the first row to the last" if linear else " from the first row to where it settles"
        sizes: tuple[Size, ...] = (Size("shift", plus_minus(shift, std, 1e6, "µm"), between),)
        if self.of == "base":
            turn, error = estimate.length(ANGLES)
            sizes = (Size("turn", shown(turn, "angle", error), between), *sizes)
        if linear:
            return sizes
        untimed = "" if estimate.timed else ", as no times are logged"
        return (*sizes, Size("settled within", f"{_settling(estimate)} to 5 %", untimed))

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """Each parameter along or about its world axis, times ``1 − exp(−t/τ)``, ``exp(−t/τ)`` or ``t/t_end``."""
        t = state.inputs.time / self.constant
        size: Scalar = t if self.course == "linear" else exp(-t) if self.course == "settling" else 1 - exp(-t)
        return frame_motion(state, [name for name, _ in self.dimensions], WORLD_AXES, foot(state), size)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        if not cls.needs <= case.inputs or case.duration <= 0:
            return []
        courses = ("exponential",) if case.robot.base_free else ("exponential", "settling")
        constants = [_seconds_text(share * case.duration) for share in _CONSTANT_SHARES]
        curves = [cls(course=course, constant=constant) for course in courses for constant in constants]
        lines = [cls(course="linear", of=of, constant=_seconds_text(case.duration)) for of in ("point", "base")]
        turning = [cls(course="exponential", of="base", constant=constant) for constant in constants]
        return [*lines, *curves, *turning]


def _settling(estimate: FittedSizes) -> str:
    value, error = (3.0 * part for part in estimate.entry("constant"))  # time constants after which 5 % are left
    return shown(value, "time", error) if estimate.timed else plus_minus(value, error, 1.0, "rows")


def _seconds_text(value: float) -> Scalar:
    return f"{value!r} s"
