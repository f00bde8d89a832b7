"""Effects of one joint or of the link behind it: periodic ones, lost motion, and what yields to the arm's weight."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

from pydantic import Field

from posture_opt.errors import BadValueError
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar, Vector, cos, cross, scale, sin, subtract
from posture_opt.model.effects.base.cause import (
    Abscissa,
    FittedSizes,
    Input,
    Size,
    amplitude,
    compliance_size,
    over_phase,
)
from posture_opt.model.effects.base.effect import NOT_NEGATIVE, Effect, Excitation, Sensitivity
from posture_opt.model.effects.base.multiples import RotatingPart, rotating_parts
from posture_opt.model.effects.base.plausible_range import PlausibleRange
from posture_opt.numerics import TURN
from posture_opt.robot.robot import Robot
from posture_opt.units import Angle, fixed, number, shown

# Amplitude [rad] up to which new gears err: positional accuracy of 1 to 2 arcmin, peak to peak, in the catalogue
CATALOGUE_AMPLITUDE = 0.3e-3
# Amplitude [rad] of one cycle per revolution up to which a disc or a gear may be off its centre: 60 µm at a radius of
# 20 mm. In more cycles three times `CATALOGUE_AMPLITUDE`, of gears that are worn or badly aligned.
_LARGEST_AMPLITUDE = 3e-3


class EffectOfJoint(Effect):
    """An effect of one joint, or of the link behind it; ``types`` are the joints that can have it."""

    types: ClassVar[tuple[str, ...]] = ("revolute",)

    joint: str = Field(description="the joint that errs")

    @property
    def target(self) -> str:
        return self.joint

    @property
    def moved_joint(self) -> str:
        return self.joint

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        return [cls.of_joint(name) for name in case.moving(*cls.types)] if cls.needs <= case.inputs else []

    @classmethod
    def of_joint(cls, joint: str, **shape: Any) -> Effect:
        """The effect of one joint, nothing estimated yet."""
        return cls(joint=joint, **shape)

    def check_robot(self, robot: Robot) -> None:
        """Refuse a joint that the robot lacks."""
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
        """``φ_k`` of each parameter, in their order: numbers, arrays (N,) or CasADi expressions."""

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
        return (self.frequency,)

    def plausible(self, robot: Robot) -> PlausibleRange | None:
        # Cycles per revolution of what is off its centre, or oval or tilted.
        high = _LARGEST_AMPLITUDE if self.frequency <= 2.0 else _LARGEST_AMPLITUDE / 3
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
        cycle = TURN / self.frequency
        text = self.inspect(robot)
        # Share of a cycle that a joint has to be moved over for the error to look like no other.
        if not 0 < estimate.span < 0.75 * cycle:
            return text
        moved, whole = (f"{math.degrees(angle):.0f}" for angle in (estimate.span, cycle))
        return (
            f"{self.joint} over a whole cycle before opening it: it was moved over {moved} of {whole} deg, where sag, "
            f"scale and offset look alike; then {text}"
        )

    @property
    def valid_between(self) -> tuple[float, float] | None:
        """The measured range, unless the error repeats after a turn; the phase of other cycles adds up errors and is
        lost."""
        # By how much a number of cycles per revolution may differ from a whole one: rounding.
        repeats = all(abs(k - round(k)) < 1e-9 for k in self.frequencies)
        return None if repeats else self.measured_range

    @property
    def unmeasured_size(self) -> float:
        """Root mean square over a cycle, ``√(Σ (a² + b²) / 2)`` [rad]."""
        return math.sqrt(sum(value**2 for value in self.values) / 2)

    def measured_over(self, low: float, high: float) -> Effect:
        """That range, rounded to a hundredth of a degree as the file has it."""
        edges = (math.radians(round(math.degrees(end), 2)) for end in (low, high))
        return self.model_copy(update={"measured_range": tuple(edges)})

    def also_measured(self, other: Effect) -> Effect:
        """The hull of both ranges, or the range of the other one."""
        theirs = getattr(other, "measured_range", None)
        if self.measured_range is None or theirs is None:
            return self.model_copy(update={"measured_range": theirs})
        ends = (*self.measured_range, *theirs)
        return self.model_copy(update={"measured_range": (min(ends), max(ends))})

    def known_everywhere(self) -> Effect:
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
        """Amplitude [mrad] and phase [deg], in place of sine and cosine: ``a sin x + b cos x = A sin(x + phase)``."""
        (a, _), (b, _) = estimate.entry("sin"), estimate.entry("cos")
        size, std = amplitude(a, b, estimate.covariance)
        return (
            Size("amplitude", shown(size, "angle", std)),
            Size("phase", f"{fixed(math.degrees(math.atan2(b, a)), 0)} deg"),
        )


REVERSED = "reversed"  # The first word of a label where the joint goes beyond its command


class LostMotion(JointEffect):
    """``dq = −θ s φ``: s = +1 where the joint value was increasing on arrival, −1 where it was decreasing; φ ≥ 0.

    A positive size θ is lost motion: the joint stops short of its command, as play, elastic wind-up and friction make
    it. A negative one goes beyond the command: what a controller that compensates friction by too much does, and what
    an encoder before the gear reads while the arm is moved by hand, as the link leads then. Data show either, so both
    signs are searched. Where s is not known it is 0.

    Source: ISO 230-2:2014, 3.10 (reversal value): the difference between the means of both directions of approach.
    """

    # What is wrong where the size is negative, in one clause
    beyond: ClassVar[str] = (
        "{target} goes beyond its command, as with friction compensation, or an encoder before the gear of an arm that "
        "is moved by hand"
    )
    # What to look at where the size is negative
    beyond_inspection: ClassVar[str] = (
        "if motors drove {target}: its friction or backlash compensation in the controller, and nothing is tightened; "
        "if it was moved by hand, and its encoder is before the gear: play or stretch of gear, belt or cable"
    )
    needs: ClassVar[frozenset[Input]] = frozenset({"approach"})

    def lag(self, state: ArmState, joint: int) -> Scalar:
        """−s: the direction in which a joint that stops short is off its command; 0 if unknown."""
        return -state.inputs.side(joint)

    def worded(self, estimate: FittedSizes) -> str:
        """The cause in one clause, by the sign of its size."""
        return self.beyond.format(target=self.target) if self.leads(estimate) else self.words

    def labelled(self, estimate: FittedSizes) -> str:
        """Reversed beyond the command: what is done about play would be wrong."""
        return f"{REVERSED} {self.label}" if self.leads(estimate) else self.label

    def inspect_fitted(self, robot: Robot, estimate: FittedSizes) -> str:
        if self.leads(estimate):
            return self.beyond_inspection.format(target=self.target)
        return self.inspect(robot)

    def leads(self, estimate: FittedSizes) -> bool:
        """Whether the joint goes beyond its command."""
        ((name, _),) = self.parameters
        values: Mapping[str, tuple[float, float, str]] = estimate.values
        return name in values and values[name][0] < 0


PAYLOAD = "payload"  # The point of the payload whose mass is stated


class GravityLoaded(Effect):
    """An effect that is a compliance times a load.

    With ``loads: points`` the masses of the links are unknown and are modelled as point masses at frames beyond: in
    place of one compliance c times the load of all masses there are products ``θ_i = c m_i``, each times the load of
    1 kg at frame i. A payload that is stated and varies has a known mass: with it, c itself is among the parameters.
    """

    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("compliance", "angle per torque"),)
    yields: ClassVar[str]  # What its size says in words: turns by of a joint, tilts by of a base

    loads: Literal["masses", "points"] = Field("masses", description="masses of the file, or unknown point masses")
    points: tuple[str, ...] = Field(
        (),
        description="joints behind which unknown masses are, `tool` for one at the tool point, `payload` for the "
        "payload as stated",
    )

    @property
    def dimensions(self) -> tuple[tuple[str, str], ...]:
        """The compliance; of unknown loads one product of compliance and mass a point [rad kg/(N m)]."""
        if self.loads == "masses":
            return self.parameters
        one = self.parameters[0]
        return tuple(one if p == PAYLOAD else (f"mass at {p}", "angle mass per torque") for p in self.points)

    @property
    def asks(self) -> frozenset[Input]:
        if self.loads == "masses":
            return frozenset({"masses"})
        return frozenset({"payload"}) if PAYLOAD in self.points else frozenset()

    @property
    def limits(self) -> tuple[float, float]:  # type: ignore[override] # of this very instance
        """Not below zero, the compliance and its products with masses."""
        return NOT_NEGATIVE

    @property
    def less_likely(self) -> bool:
        """Of links and base without masses: joints are most of an arm's compliance."""
        return self.loads == "points"

    @property
    def unstated_loads(self) -> bool:
        """Whether masses are unknown, and the payload is too, so that no parameter is the compliance itself."""
        return self.loads == "points" and PAYLOAD not in self.points

    def moments(self, state: ArmState, carrier: int, about: Vector) -> list[Vector]:
        """Moment (3,) about a point (3,) [m], world, for each parameter: of all weights behind joint ``carrier`` (−1:
        all) or the payload [N m], or of 1 kg at each point [N m/kg]."""
        if self.loads == "masses":
            return [state.moment(carrier, about)]
        weights = (scale(mass, state.robot.gravity) for mass, _ in self.masses(state))
        places = (place for _, place in self.masses(state))
        return [cross(subtract(place, about), weight) for place, weight in zip(places, weights, strict=True)]

    def masses(self, state: ArmState) -> list[tuple[Scalar, Vector]]:
        """Mass [kg] and place (3,) [m], world, for each parameter; 1 kg of an unknown one."""
        names = state.robot.joint_names
        found: list[tuple[Scalar, Vector]] = []
        for point in self.points:
            place = state.tool if point in ("tool", PAYLOAD) else state.frames[names.index(point)].position
            found.append((state.inputs.payload if point == PAYLOAD else 1.0, place))
        return found

    @classmethod
    def frames_of_load(cls, case: Excitation, first: int) -> tuple[str, ...]:
        """Where masses may be: the payload if it varies, the tool point, and frames from joint ``first`` on, the last
        first."""
        payload = (PAYLOAD,) if "payload" in case.inputs else ()
        return (*payload, "tool", *reversed(case.robot.joint_names[first:-1]))

    def size(self, name: str, dimension: str, value: float, std: float) -> Size:
        return compliance_size(name, value, std)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """The compliance; of unknown loads the turn in the data [mrad] and what that costs."""
        if not self.unstated_loads:
            return (self.size("compliance", self.parameters[0][1], *estimate.entry("compliance")),)
        low, high = estimate.turn or (math.nan, math.nan)
        masses = (
            f"not stated: {len(self.points)} products of load and compliance in place of one compliance, and the "
            "stiffness stays open; state 'mass' and 'com' of every joint"
        )
        return Size(self.yields, f"{number(1e3 * low)} to {number(1e3 * high)} mrad in these data"), Size(
            "masses", masses
        )

    def headline(self, estimate: FittedSizes) -> str:
        """Compliance and stiffness; of unknown loads the RMS of the turn in the data about its mean."""
        if not self.unstated_loads:
            compliance = estimate.entry("compliance")[0]
            stiffness = f", {number(1e-3 / compliance)} kN m/rad" if compliance > 0 else ""
            return f"{super().headline(estimate)}{stiffness}"
        return (
            "" if not estimate.rms or not estimate.rms[0] else f"{shown(estimate.rms[0], 'angle', estimate.rms[1])} RMS"
        )

    def plausible_size(self, estimate: FittedSizes) -> tuple[float, float]:
        """The compliance [rad/(N m)]; of unknown loads half the range of the turn in the data [rad]."""
        if not self.unstated_loads:
            return super().plausible_size(estimate)
        low, high = estimate.turn or (0.0, 0.0)
        return (high - low) / 2, math.nan
