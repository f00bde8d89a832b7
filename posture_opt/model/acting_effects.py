"""``ActingEffects``: the effects of an arm under its inputs, their parameters, and what these do at a posture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from posture_opt.model.arm_state import ArmState, Inputs
from posture_opt.model.chain import Scalar
from posture_opt.numerics import Json
from posture_opt.robot.robot import Robot

if TYPE_CHECKING:  # a plain chain needs none of the effects, which are many files
    from posture_opt.model.effects.base.effect import Effect, Sensitivity


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
