"""``ArmState``: the nominal arm at its postures with what loads it, as effects need it; their ``Inputs``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.model.chain import ZERO, Scalar, Vector, Walk, add, cross, dot, factor_values, scale, subtract, walk
from posture_opt.numerics import Codes, Json
from posture_opt.robot.robot import Robot

if TYPE_CHECKING:  # a plain chain needs none of the effects, which are many files
    from posture_opt.model.effects.base.effect import Effect, Sensitivity


# degC at which the lengths of a model hold (ISO 1); a task without a temperature is done there
REFERENCE_TEMPERATURE = 20.0


MIN_LEANING_SINE = 0.1  # Sine of the tilt of an axis below which gravity loads its joint with next to nothing: 6°


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of effects at one posture, or at N of them as arrays (N,)."""

    payload: Scalar = 0.0  # mass at the tool point [kg]
    # (n,) +1 where the joint value was increasing on arrival, −1 where it was decreasing, 0 where that is not known.
    # Empty: all unknown
    approach: Sequence[Scalar] = ()
    approach_length: Sequence[Scalar] = ()  # (n,) length of that last move [rad or m]; empty: long moves
    temperature: Scalar = 0.0  # above the reference temperature [K]
    time: Scalar = 0.0  # since the first measurement [s]; rows are counted where no time is given
    stated: tuple[str, ...] = ()  # names of the joints whose side is known
    speed: Sequence[Scalar] = ()  # (n,) of the joints at the moment of the row [rad/s or m/s]; empty: at rest

    def take(self, rows: Codes) -> Inputs:
        """The inputs of some of N postures, by index; the time stays the one since the first measurement of all."""
        return Inputs(
            self.payload[rows], [side[rows] for side in self.approach], [way[rows] for way in self.approach_length],
            self.temperature[rows], self.time[rows], self.stated, [speed[rows] for speed in self.speed],
        )  # fmt: skip

    def side(self, joint: int) -> Scalar:
        """Side of arrival: +1 as the joint value increased, −1 as it decreased, 0 if unknown."""
        return self.approach[joint] if len(self.approach) else 0.0

    def travel(self, joint: int) -> Scalar:
        """The length of the last move of a joint [rad or m]; 1e6, longer than any, where none is known."""
        return self.approach_length[joint] if len(self.approach_length) else 1e6


def _placed(frame: Walk, local: Sequence[float]) -> Vector:
    """The point (3,) of a frame in the world [m]."""
    (a, b, c), (x, y, z) = frame.columns, local
    return add(add(add(frame.position, scale(x, a)), scale(y, b)), scale(z, c))


@dataclass(frozen=True, eq=False)
class ArmState:
    """The arm without effects at the commanded joints ``q`` under ``inputs``: one posture, or N of them."""

    robot: Robot  # the chain, with masses and gravity
    q: Sequence[Scalar]  # (n,) commanded joints [rad or m]: numbers, arrays (N,) or CasADi expressions
    inputs: Inputs = field(default_factory=Inputs)  # payload, temperature, time, sides
    # deviations of parameters from the file's arm, of frames that were found from data for example [rad or m]
    p: Mapping[str, Scalar] = field(default_factory=dict)
    # joint index -> how far whole joints are off their commands, as another joint carries them along [rad]
    carried: Mapping[int, Scalar] = field(default_factory=dict)

    @cached_property
    def _factor_values(self) -> list[Scalar]:
        """The value of every factor of the chain [rad or m]."""
        joints = [value + self.carried[i] if i in self.carried else value for i, value in enumerate(self.q)]
        return factor_values(self.robot.factors, joints, self.p)

    @cached_property
    def walk(self) -> Walk:
        """The chain without effects: pose of the tool and all screws, world."""
        return walk(self.robot.factors, self._factor_values)

    @property
    def tool(self) -> Vector:
        """The tool point in the world [m]."""
        return self.walk.position

    @cached_property
    def frames(self) -> tuple[Walk, ...]:
        """(n,) the frame behind every joint, which moves with its link."""
        found, first = [], len(self.robot.base)
        here = walk(self.robot.base, self._factor_values[:first])
        for link in self.robot.links:
            here = walk(link, self._factor_values[first : first + len(link)], here)
            first += len(link)
            found.append(here)
        return tuple(found)

    def axis(self, joint: int) -> tuple[Vector, Vector]:
        """Unit vector (3,) along the axis of a joint and a point (3,) on it [m], world frame."""
        screw = self.walk.screws[self.robot.driven[joint]]
        return screw.axis, screw.origin

    def leaning(self, joint: int) -> float:
        """Sine of the largest angle of a joint's axis to the vertical over all postures; 1 of slides and without
        gravity."""
        axis, g = self.axis(joint)[0], self.robot.gravity
        weight = math.hypot(*g)
        if self.robot.joints[joint].type == "prismatic" or not weight:
            return 1.0
        across = np.stack(np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in cross(axis, g))))
        return float(np.max(np.linalg.norm(across, axis=0))) / weight

    @property
    def weighed(self) -> bool:
        """Whether all masses and centres are known, but of a first link that turns about the vertical: it loads no
        joint."""
        joints = self.robot.joints
        axis, g = self.axis(0)[0], self.robot.gravity
        upright = joints[0].type == "revolute" and all(abs(v) < 1e-2 * math.hypot(*g) for v in cross(axis, g))
        return all(math.isfinite(j.mass) and all(map(math.isfinite, j.com)) for j in joints[upright:])

    @cached_property
    def loads(self) -> tuple[tuple[int, Scalar, Vector], ...]:
        """(joint that carries it, mass [kg], place (3,) in the world [m]) of every known link, the payload last."""
        links = [
            (i, joint.mass, _placed(self.frames[i], joint.com))
            for i, joint in enumerate(self.robot.joints)
            if math.isfinite(joint.mass) and joint.mass > 0 and all(map(math.isfinite, joint.com))
        ]
        return (*links, (self.robot.n - 1, self.inputs.payload, self.tool))

    def torque(self, joint: int) -> Scalar:
        """Gravity on a joint [N m, or N]: ``τ_j = Σ_k m_k (a_j × (x_k − o_j)) · g`` over its loads, ``a_j · g`` of a
        slide."""
        total: Scalar = 0.0
        for carrier, mass, place in self.loads:
            if carrier >= joint:
                total = total + mass * self.unit_torque(joint, place)
        return total

    def payload_torque(self, joint: int) -> Scalar:
        """The payload's part of `torque` [N m, or N]."""
        return self.inputs.payload * self.unit_torque(joint, self.tool)

    def unit_torque(self, joint: int, place: Vector) -> Scalar:
        """The generalised force [N m, or N] on a joint of 1 kg at a place (3,) of the world [m]."""
        axis, origin = self.axis(joint)
        g = self.robot.gravity
        if self.robot.joints[joint].type == "prismatic":
            return dot(axis, g)
        return dot(cross(axis, subtract(place, origin)), g)

    def moment(self, carrier: int, about: Vector) -> Vector:
        """Moment (3,) [N m] about a point (3,) [m], world, of all weights behind joint ``carrier``; −1 counts every
        link."""
        total = ZERO
        for behind, mass, place in self.loads:
            if behind > carrier:
                weight = scale(mass, self.robot.gravity)
                total = add(total, cross(subtract(place, about), weight))
        return total


@dataclass(frozen=True)
class MeasuredRange:
    """An effect that is known between two values of its joint only, and a joint that may leave them."""

    effect: Effect  # which is not corrected beyond
    joint: int  # index of the joint; low, high: its values [rad]
    low: float
    high: float

    @property
    def name(self) -> str:
        """``kind(target).unmeasured``, an error of standard deviation 1."""
        return f"{self.effect.name}.unmeasured"

    def to_json(self) -> dict[str, Json]:
        effect = {"kind": self.effect.kind, "target": self.effect.target}
        return {"effect": effect, "range": [self.low, self.high], "size": self.effect.unmeasured_size}

    def inside(self, q: Sequence[Scalar]) -> Scalar:
        """1 where the joints q (n,) are within the range, to `_EDGE_RAD`, else 0."""
        value = q[self.joint]
        return 1.0 * (value >= self.low - _EDGE_RAD) * (value <= self.high + _EDGE_RAD)

    def beyond(self, q: Sequence[Scalar]) -> Sensitivity:
        """One standard deviation of the unknown error as an increment of the joint [rad] at the joints q (n,)."""
        return self.effect.unknown_beyond(self.joint, 1.0 - self.inside(q))


# What a joint may leave a measured range by: compensation moves it by less, and its edge is not sharp
_EDGE_RAD = math.radians(0.5)

# A sum of sensitivities, each with its weight in the unit of its parameter [SI]
Weighted = list[tuple[Scalar, "Sensitivity"]]

# Step of central differences by a shape, in its own or its logarithm's unit: the derivative is good to 1e-6 of itself
_SHAPE_STEP = 1e-3


@dataclass(frozen=True)
class ActingEffects:
    """Effects of a robot with the sizes of their estimates, under inputs that say how far they act."""

    robot: Robot  # the chain that they act on
    effects: tuple[Effect, ...]  # with their estimates; none for a plain chain
    inputs: Inputs  # payload, temperature, time and sides of approach under which the effects act

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """(e,) names of the parameters of all effects, ``kind(target).parameter``."""
        return tuple(name for effect in self.effects for name in effect.parameter_names)

    @cached_property
    def shapes(self) -> dict[str, int]:
        """``kind(target).shape`` of every effect that depends smoothly on its shape, and its place in ``effects``."""
        return {
            f"{effect.name}.{effect.smooth_shape}": i for i, effect in enumerate(self.effects) if effect.smooth_shape
        }

    @cached_property
    def unknown_sides(self) -> tuple[str, ...]:
        """``JOINT.side`` of every joint of an effect whose side of arrival no task states: −1 or +1 alike."""
        return tuple(f"{joint}.side" for joint in dict.fromkeys(e.target for e in self.effects if self._lacks_side(e)))

    @cached_property
    def ranges(self) -> dict[int, MeasuredRange]:
        """Place in ``effects`` -> the range, of every effect that is not known at all values its joint may take."""
        found, names = {}, self.robot.joint_names
        for place, effect in enumerate(self.effects):
            between = effect.valid_between
            if between is not None:
                joint = names.index(effect.target)
                limits = self.robot.joints[joint]
                if limits.lower < between[0] - _EDGE_RAD or limits.upper > between[1] + _EDGE_RAD:
                    found[place] = MeasuredRange(effect, joint, *between)
        return found

    @cached_property
    def estimates(self) -> tuple[float, ...]:
        """(e,) the estimates of the effects, in the order of `parameters` [SI]."""
        return tuple(value for effect in self.effects for value in effect.values)

    def in_size(self, q: Sequence[Scalar], p: Mapping[str, Scalar], ones: Sequence[Sensitivity]) -> Weighted:
        """Pairs of a size [SI], estimate and deviation in ``p``, and the effect of one unit of it at joints q (n,) [rad
        or m]."""
        sizes = [v + p.get(name, 0.0) for name, v in zip(self.parameters, self.estimates, strict=True)]
        parts = list(zip(sizes, ones, strict=True))
        for found in self.ranges.values():
            if found.name in p:
                parts.append((p[found.name], found.beyond(q)))
        if any(side in p for side in self.unknown_sides):
            for side, by_side in self._side_sensitivities(q, p).items():
                parts += [(p.get(side, 0.0) * sizes[place], one) for place, one in by_side]
        return parts

    def per_unit(
        self, q: Sequence[Scalar], p: Mapping[str, Scalar], known: Sequence[Sensitivity] = ()
    ) -> dict[str, Weighted]:
        """Effects of one unit of every parameter and unknown side at q (n,) [rad or m] and deviations p [SI], to first
        order."""
        ones = zip(self.parameters, known or self.sensitivities(q, p), strict=True)
        found: dict[str, Weighted] = {name: [(1.0, one)] for name, one in ones}
        found |= {there.name: [(1.0, there.beyond(q))] for there in self.ranges.values()}
        for side, parts in self._side_sensitivities(q, p).items() if self.unknown_sides else ():
            found[side] = [(self.estimates[place], one) for place, one in parts]
        return found

    def per_shape(self, name: str, q: Sequence[Scalar], p: Mapping[str, Scalar]) -> Weighted:
        """The derivative by a shape [SI] in central differences, at q (n,) [rad or m]; numbers only, a shape is no
        symbol."""
        place = self.shapes[name]
        first = sum(len(effect.dimensions) for effect in self.effects[:place])
        state, at, found = self._bare_state(q, p, self.inputs), float(p.get(name, 0.0)), []
        for step in (_SHAPE_STEP, -_SHAPE_STEP):
            for k, one in enumerate(self._known(place, self.effects[place].reshaped(at + step), state), first):
                size = self.estimates[k] + p.get(self.parameters[k], 0.0)
                found.append((size / (2 * step), one))
        return found

    def _bare_state(self, q: Sequence[Scalar], p: Mapping[str, Scalar], inputs: Inputs) -> ArmState:
        """The arm without effects, with the frames and lengths that ``p`` states."""
        known = self.robot.parameters
        return ArmState(self.robot, q, inputs, {name: v for name, v in p.items() if name in known}, self.carried(q))

    def carried(self, q: Sequence[Scalar]) -> dict[int, Scalar]:
        """Joint index -> how far joints are off their commands as others carry them along [rad]."""
        return {joint: value for effect in self.effects for joint, value in effect.carried(self.robot, q).items()}

    def sensitivities(self, q: Sequence[Scalar], p: Mapping[str, Scalar]) -> list[Sensitivity]:
        """(e,) what each parameter does, of effects with the shapes that ``p`` states."""
        effects = list(self.effects)
        for name, i in self.shapes.items():
            if name in p:
                effects[i] = effects[i].reshaped(float(p[name]))
        state = self._bare_state(q, p, self.inputs)
        return [one for place, effect in enumerate(effects) for one in self._known(place, effect, state)]

    def _known(self, place: int, effect: Effect, state: ArmState) -> tuple[Sensitivity, ...]:
        """The effect at a ``place`` in the shape of ``effect``; nothing beyond its measured range."""
        ones = effect.sensitivities(state)
        if place not in self.ranges:
            return ones
        inside = self.ranges[place].inside(state.q)
        return tuple(one.scaled(inside) for one in ones)

    def _side_sensitivities(
        self, q: Sequence[Scalar], p: Mapping[str, Scalar]
    ) -> dict[str, list[tuple[int, Sensitivity]]]:
        state = self._bare_state(q, p, replace(self.inputs, approach=[1.0] * self.robot.n))
        found: dict[str, list[tuple[int, Sensitivity]]] = {side: [] for side in self.unknown_sides}
        place = 0
        for effect in self.effects:
            if self._lacks_side(effect):
                found[f"{effect.target}.side"] += enumerate(effect.sensitivities(state), place)
            place += len(effect.dimensions)
        return found

    def _lacks_side(self, effect: Effect) -> bool:
        return "approach" in effect.needs and effect.target not in self.inputs.stated
