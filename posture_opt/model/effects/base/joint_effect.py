"""Effects of one joint: of its value, or of the link behind it; those that are periodic in its value."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

from pydantic import Field

from posture_opt.errors import BadValueError
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar, cos, sin
from posture_opt.model.effects.base.cause import Abscissa, FittedSizes, Size, amplitude, over_phase
from posture_opt.model.effects.base.effect import Effect, Excitation, Sensitivity
from posture_opt.model.effects.base.plausible_range import PlausibleRange
from posture_opt.model.effects.base.rotating_parts import RotatingPart, rotating_parts
from posture_opt.numerics import TURN
from posture_opt.robot.robot import Robot
from posture_opt.units import Angle, fixed, shown

CATALOGUE_AMPLITUDE = 0.3e-3
"""Amplitude [rad] up to which new gears err: positional accuracy of 1 to 2 arcmin, peak to peak, in the catalogue."""
_LARGEST_AMPLITUDE = 3e-3
"""Amplitude [rad] of one cycle per revolution up to which a disc or a gear may be off its centre: 60 µm at a radius of
20 mm. In more cycles three times `CATALOGUE_AMPLITUDE`, of gears that are worn or badly aligned."""
_DISC_CYCLES = 2.0
"""Cycles per revolution of what is off its centre, or oval or tilted."""
_WHOLE_CYCLE_SHARE = 0.75
"""Share of a cycle that a joint has to be moved over for the error to look like no other."""
_WHOLE_CYCLES = 1e-9
"""By how much a number of cycles per revolution may differ from a whole one: rounding."""


class EffectOfJoint(Effect):
    """An effect of one joint, or of the link behind it; ``types`` are the joints that can have it."""

    types: ClassVar[tuple[str, ...]] = ("revolute",)

    joint: str = Field(description="the joint that errs")

    @property
    def target(self) -> str:
        """The joint."""
        return self.joint

    @property
    def moved_joint(self) -> str:
        """The joint."""
        return self.joint

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        """One for every joint of its types that moves in the data, where the inputs that it needs are known."""
        return [cls.of_joint(name) for name in case.moving(*cls.types)] if cls.needs <= case.inputs else []

    @classmethod
    def of_joint(cls, joint: str, **shape: Any) -> Effect:
        """The effect of one joint, nothing estimated yet."""
        return cls(joint=joint, **shape)

    def check_robot(self, robot: Robot) -> None:
        """Refuse a joint that the robot lacks.

        Raises:
            BadValueError: no such joint, or one of another type.
        """
        types = {j.name: j.type for j in robot.joints}
        if self.joint not in types:
            raise BadValueError(f"the robot has no joint '{self.joint}'", f"its joints: {', '.join(types)}")
        if types[self.joint] not in self.types:
            message = f"{self.kind} is of {' and '.join(self.types)} joints, and {self.joint} is {types[self.joint]}"
            raise BadValueError(message)


class JointEffect(EffectOfJoint):
    """An effect that adds to one joint: ``dq = Σ θ_k φ_k(q, u)`` [rad or m], with parameters θ and inputs u."""

    @abstractmethod
    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """``φ_k`` of each parameter, in their order: numbers, arrays (N,) or CasADi expressions.

        Args:
            state: the arm and its inputs.
            joint: index of the joint that errs.
        """

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """Each feature as an increment of the joint, per unit of its parameter."""
        joint = self.index(state)
        return tuple(Sensitivity({joint: feature}) for feature in self.features(state, joint))

    def index(self, state: ArmState) -> int:
        """Index of the joint in the arm."""
        return state.robot.joint_names.index(self.joint)


class Harmonic(JointEffect):
    """``dq = a sin(k q) + b cos(k q)``, k cycles per revolution; a and b in rad."""

    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("sin", "angle"), ("cos", "angle"))

    measured_range: tuple[Angle, Angle] | None = Field(
        None, description="least and largest value of the joint that it was found from; beyond, it counts as unknown"
    )

    @property
    @abstractmethod
    def frequency(self) -> float:
        """k, cycles per revolution of the joint."""

    @property
    def frequencies(self) -> tuple[float, ...]:
        """Cycles per revolution of all its lines."""
        return (self.frequency,)

    def plausible(self, robot: Robot) -> PlausibleRange | None:
        """Up to `_LARGEST_AMPLITUDE` of one cycle and of two, and a third of it of more."""
        high = _LARGEST_AMPLITUDE if self.frequency <= _DISC_CYCLES else _LARGEST_AMPLITUDE / 3
        needs = "a gear or an encoder that errs by more than any in a catalogue"
        return PlausibleRange(0.0, high, "angle", needs, "Harmonic Drive, catalogue CSF and CSG, positional accuracy")

    def plausible_size(self, estimate: FittedSizes) -> tuple[float, float]:
        """The amplitude of its first line [rad]."""
        (a, _), (b, _) = estimate.entry("sin"), estimate.entry("cos")
        return amplitude(a, b, None if estimate.covariance is None else estimate.covariance[:2, :2])

    def rotating_parts(self, robot: Robot) -> tuple[RotatingPart, ...]:
        """Parts of the joint that turn as often as a line repeats, by the gear ratio of the file or a common one."""
        ratios = {joint.name: joint.gear_ratio for joint in robot.joints}
        return rotating_parts(self.frequencies, ratios.get(self.joint, math.nan))

    def inspect_fitted(self, robot: Robot, estimate: FittedSizes) -> str:
        """What to look at, first of all the rest of its cycle where the joint was moved over a part of it only."""
        cycle = TURN / self.frequency
        text = self.inspect(robot)
        if not 0 < estimate.span < _WHOLE_CYCLE_SHARE * cycle:
            return text
        moved, whole = (f"{math.degrees(angle):.0f}" for angle in (estimate.span, cycle))
        return (
            f"{self.joint} over a whole cycle before opening it: it was moved over {moved} of {whole} deg, where sag, "
            f"scale and offset look alike; then {text}"
        )

    @property
    def valid_between(self) -> tuple[float, float] | None:
        """The measured range, unless the error repeats after a whole turn: then its phase is the same everywhere.

        Cycles that are found from data have an error, and the phase is lost where it has added up.
        """
        repeats = all(abs(k - round(k)) < _WHOLE_CYCLES for k in self.frequencies)
        return None if repeats else self.measured_range

    @property
    def unmeasured_size(self) -> float:
        """Root mean square over a cycle, ``√(Σ (a² + b²) / 2)`` [rad]."""
        return math.sqrt(sum(value**2 for value in self.values) / 2)

    def measured_over(self, low: float, high: float) -> Effect:
        """The same effect with that range, rounded to a hundredth of a degree as its file has it."""
        edges = (math.radians(round(math.degrees(end), 2)) for end in (low, high))
        return self.model_copy(update={"measured_range": tuple(edges)})

    def also_measured(self, other: Effect) -> Effect:
        """The same effect with the hull of both ranges; with the range of the other one where it has none."""
        theirs = getattr(other, "measured_range", None)
        if self.measured_range is None or theirs is None:
            return self.model_copy(update={"measured_range": theirs})
        ends = (*self.measured_range, *theirs)
        return self.model_copy(update={"measured_range": (min(ends), max(ends))})

    def known_everywhere(self) -> Effect:
        """The same effect without its range."""
        return self if self.measured_range is None else self.model_copy(update={"measured_range": None})

    def to_dict(self) -> dict[str, Any]:
        """The entry of ``effects:``; the range in degrees."""
        entry = super().to_dict()
        if self.measured_range is not None:
            entry["measured_range"] = [f"{round(math.degrees(end), 9):.12g} deg" for end in self.measured_range]
        return entry

    def features(self, state: ArmState, joint: int) -> tuple[Scalar, ...]:
        """(sin(k q), cos(k q))."""
        angle = self.frequency * state.q[joint]
        return sin(angle), cos(angle)

    def abscissa(self, state: ArmState, timed: bool = True) -> Abscissa | None:
        """The phase of the cycle [deg]."""
        return over_phase(state, self.index(state), self.frequency)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """Amplitude [mrad] and phase [deg], in place of sine and cosine: ``a sin x + b cos x = A sin(x +
        phase)``.
        """
        (a, _), (b, _) = estimate.entry("sin"), estimate.entry("cos")
        size, std = amplitude(a, b, estimate.covariance)
        return (
            Size("amplitude", shown(size, "angle", std)),
            Size("phase", f"{fixed(math.degrees(math.atan2(b, a)), 0)} deg"),
        )
