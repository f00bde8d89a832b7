"""``Arm``: the symbolic forward model ``pose = fk(q, p, u)`` that everything else is derived from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import casadi as ca
import numpy as np

from posture_opt.model.arm_state import ArmState, Inputs
from posture_opt.model.chain import (
    ZERO,
    Scalar,
    Vector,
    Walk,
    add,
    cross,
    factor_values,
    position_column,
    rotation_column,
    scale,
    stack,
    walk,
)
from posture_opt.robot.robot import Robot

if TYPE_CHECKING:  # a plain chain needs none of the effects, which are many files
    from posture_opt.model.effects.effect import Effect, Sensitivity

_SHAPE_STEP = 1e-3  # of a shape: its derivative by differences is good to 1e-6 of itself
Twist = tuple[Vector, Vector]
"""Shift of the tool point and small rotation of the tool ``(v, ω)``, world axes."""


class HasArm(Protocol):
    """Anything that names an arm, such as a ``Problem``."""

    @property
    def arm(self) -> Arm: ...


@dataclass(frozen=True)
class Reached:
    """Where the tool comes to, and how: the chain with its effects at one posture, or at N of them.

    Args:
        walk: pose of the tool and the screw of every factor.
        values: the value of every factor, effects included [rad or m].
        shift: what effects add to the tool point behind the chain, world [m].
    """

    walk: Walk
    values: list[Scalar]
    shift: Vector


@dataclass(frozen=True)
class Arm:
    """The forward model of a robot with effects: joints ``q``, named parameters ``p`` and inputs in, tool pose out.

    ``parameters`` fixes the order of ``p``: geometry and frames from the base to the tool, then those of the effects.
    Every parameter is a deviation: from the nominal value of the geometry, from the estimate of an effect.
    All methods take CasADi expressions, numbers, or arrays (N,) of them, and return the like.

    Args:
        effects: with their estimates; none for a plain chain.
        inputs: payload, temperature, time and sides of approach under which the effects act.
    """

    robot: Robot
    effects: tuple[Effect, ...] = ()
    inputs: Inputs = field(default_factory=Inputs, compare=False)

    @classmethod
    def from_problem(cls, problem: HasArm) -> Arm:
        """The arm of a problem."""
        return problem.arm

    def under(self, inputs: Inputs) -> Arm:
        """The same arm under other inputs."""
        return replace(self, inputs=inputs)

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the model parameters, from the base to the tool, and those of the effects."""
        return (*self.robot.parameters, *self.effect_parameters)

    @cached_property
    def effect_parameters(self) -> tuple[str, ...]:
        """Names of the parameters of all effects, ``kind(target).parameter``."""
        return tuple(name for effect in self.effects for name in effect.parameter_names)

    @cached_property
    def shape_parameters(self) -> dict[str, int]:
        """``kind(target).shape`` of every effect that depends smoothly on its shape, and its place in ``effects``.

        They are parameters for a fit alone: deviations of the shape, of its logarithm where errors of it are relative.
        """
        return {
            f"{effect.name}.{effect.smooth_shape}": i for i, effect in enumerate(self.effects) if effect.smooth_shape
        }

    @cached_property
    def dimensions(self) -> dict[str, str]:
        """The dimension of every parameter of an effect."""
        return {
            name: dimension
            for effect in self.effects
            for name, (_, dimension) in zip(effect.parameter_names, effect.dimensions, strict=True)
        }

    @cached_property
    def estimates(self) -> tuple[float, ...]:
        """The estimates of the effects, in the order of `effect_parameters` [SI]."""
        return tuple(value for effect in self.effects for value in effect.values)

    @cached_property
    def unknown_sides(self) -> tuple[str, ...]:
        """``JOINT.side`` of every joint of an effect whose side of arrival no task states: −1 or +1, odds equal."""
        return tuple(f"{joint}.side" for joint in dict.fromkeys(e.target for e in self.effects if self._sideless(e)))

    @cached_property
    def q(self) -> ca.SX:
        """(n,) joint symbols [rad or m]."""
        return ca.SX.sym("q", self.robot.n)

    def walk(self, q: Any, p: Any = None) -> Walk:
        """The walk along the chain at ``q`` (n,) and ``p`` (k,): pose and screws as scalars."""
        named: dict[str, Any] = {}
        if p is not None:
            named = dict(zip(self.parameters, split(p, len(self.parameters), "parameters"), strict=True))
        return self.reach(split(q, self.robot.n, "posture"), named).walk

    def pose(self, q: Any, p: Any = None) -> Any:
        """``T_world_tool`` (4, 4) [m], a CasADi expression where ``q`` or ``p`` is one, else an array."""
        reached = self.walk(q, p)
        (r0, r1, r2), x = reached.columns, reached.position
        return stack([(r0[k], r1[k], r2[k], x[k]) for k in range(3)] + [(0.0, 0.0, 0.0, 1.0)])

    def position(self, q: Any, p: Any = None) -> Any:
        """The tool point (3,) in the world [m]."""
        return stack(self.walk(q, p).position)

    def jacobian(self, q: Any, p: Any = None) -> Any:
        """The geometric Jacobian (6, n) of the tool point, rows ``(v, ω)``, world-aligned axes."""
        driven = [self.robot.factors[i].parameter or i for i in self.robot.driven]
        return self._stacked(self.twists(driven, split(q, self.robot.n, "posture"), self.walk(q, p)))

    def parameter_jacobian(self, q: Any, p: Any = None) -> Any:
        """``∂(x, φ)/∂p`` (6, k): tool-point shift and small rotation per parameter, world-aligned axes."""
        joints = split(q, self.robot.n, "posture")
        return self._stacked(self.twists(self.parameters, joints, self.walk(q, p)))

    def reach(self, q: Sequence[Scalar], p: Mapping[str, Scalar] | None = None) -> Reached:
        """Where the chain with its effects brings the tool.

        Joint and length increments of effects enter the chain itself; what they shift and turn at the end is added
        behind it, to second order in the turn. Effects act as on the arm without them that stands where ``p`` says.

        Args:
            q: (n,) commanded joints [rad or m].
            p: deviations of named parameters, those of effects and unknown sides among them.
        """
        robot, p = self.robot, p or {}
        values = factor_values(robot.factors, q, p)
        if not self.effects:
            return Reached(walk(robot.factors, values), values, ZERO)
        shift, turn = ZERO, ZERO
        for size, one in self._sized(q, p):
            for index, increment in self._increments(one):
                values[index] = values[index] + size * increment
            v, w = one.twist
            shift = shift if v is ZERO else add(shift, scale(size, v))
            turn = turn if w is ZERO else add(turn, scale(size, w))
        reached = walk(robot.factors, values)
        if shift is ZERO and turn is ZERO:
            return Reached(reached, values, ZERO)
        columns = reached.columns if turn is ZERO else tuple(_turned(turn, column) for column in reached.columns)
        moved = Walk(columns, add(reached.position, shift), reached.screws)  # type: ignore[arg-type]
        return Reached(moved, values, shift)

    def twists(
        self, names: Iterable[str | int], q: Sequence[Scalar], reached: Walk, p: Mapping[str, Scalar] | None = None
    ) -> list[Twist]:
        """Sensitivity of the tool to named parameters: shift of its point and small rotation per unit of each.

        For a factor with the axis a and the origin o: ``(a × (x − o), a)`` if it rotates, else ``(a, 0)``; for a
        parameter of an effect the sum of what it adds to joints, lengths and behind the chain, to first order. This
        is the only place where a column is made: of geometry, frames, joint values, effects and sides alike.

        Args:
            names: of parameters, of `unknown_sides`, or indices into ``robot.factors``.
            q: (n,) commanded joints; reached: the walk there; p: the deviations that the effects see.
        """
        factors, found = self._factor_index, []
        sizes: dict[str, Twist] = {}
        for name in names:
            index = name if isinstance(name, int) else factors.get(name)
            if index is not None:
                found.append((position_column(reached, index), rotation_column(reached, index)))
                continue
            if name in self.shape_parameters:
                found.append(self._shape_twist(str(name), q, reached, p or {}))
                continue
            sizes = sizes or self._effect_twists(q, reached, p or {})
            found.append(sizes[str(name)])
        return found

    def twist_of(self, reached: Walk, one: Sensitivity) -> Twist:
        """Shift and small rotation by one unit of what an effect does."""
        shift, turn = one.twist
        for index, size in self._increments(one):
            shift = add(shift, scale(size, position_column(reached, index)))
            turn = add(turn, scale(size, rotation_column(reached, index)))
        return shift, turn

    @cached_property
    def _factor_index(self) -> dict[str, int]:
        return {f.parameter: i for i, f in enumerate(self.robot.factors) if f.parameter}

    def _increments(self, one: Sensitivity) -> list[tuple[int, Scalar]]:
        """(index of a factor, increment) of everything that one unit adds to the chain."""
        driven = self.robot.driven if one.joints else ()
        parts = [(driven[joint], size) for joint, size in one.joints.items()]
        return parts + [(self._factor_index[name], size) for name, size in one.lengths.items()]

    def _state(self, q: Sequence[Scalar], p: Mapping[str, Scalar], inputs: Inputs) -> ArmState:
        """The arm without effects, with the frames and lengths that ``p`` says."""
        return ArmState(self.robot, q, inputs, {name: v for name, v in p.items() if name in self._factor_index})

    def _sensitivities(self, q: Sequence[Scalar], p: Mapping[str, Scalar]) -> list[Sensitivity]:
        state = self._state(q, p, self.inputs)
        return [one for effect in self._shaped(p) for one in effect.moves(state)]

    def _shaped(self, p: Mapping[str, Scalar]) -> Sequence[Effect]:
        """The effects with the shapes that ``p`` says."""
        effects = list(self.effects)
        for name, i in self.shape_parameters.items():
            if name in p:
                effects[i] = reshaped(effects[i], float(p[name]))
        return effects

    def _shape_twist(self, name: str, q: Sequence[Scalar], reached: Walk, p: Mapping[str, Scalar]) -> Twist:
        """Derivative by a shape: by central differences of what the effect does with its present size."""
        place = self.shape_parameters[name]
        first = sum(len(effect.dimensions) for effect in self.effects[:place])
        state, at = self._state(q, p, self.inputs), float(p.get(name, 0.0))
        shift, turn = ZERO, ZERO
        for step in (_SHAPE_STEP, -_SHAPE_STEP):
            for k, one in enumerate(reshaped(self.effects[place], at + step).moves(state), first):
                size = self.estimates[k] + p.get(self.effect_parameters[k], 0.0)
                v, w = self.twist_of(reached, one)
                rate = size / (2 * step)
                shift, turn = add(shift, scale(rate, v)), add(turn, scale(rate, w))
        return shift, turn

    def _side_sensitivities(
        self, q: Sequence[Scalar], p: Mapping[str, Scalar]
    ) -> list[tuple[str, list[tuple[int, Sensitivity]]]]:
        """For each unknown side what arriving from above does: place among the parameters, and what each does."""
        state = self._state(q, p, replace(self.inputs, approach=[1.0] * self.robot.n))
        found: dict[str, list[tuple[int, Sensitivity]]] = {side: [] for side in self.unknown_sides}
        place = 0
        for effect in self.effects:
            if self._sideless(effect):
                found[f"{effect.target}.side"] += enumerate(effect.moves(state), place)
            place += len(effect.dimensions)
        return list(found.items())

    def _sized(self, q: Sequence[Scalar], p: Mapping[str, Scalar]) -> list[tuple[Scalar, Sensitivity]]:
        """What all effects do, each with the size of its parameter."""
        sizes = [v + p.get(name, 0.0) for name, v in zip(self.effect_parameters, self.estimates, strict=True)]
        parts = list(zip(sizes, self._sensitivities(q, p), strict=True))
        if any(side in p for side in self.unknown_sides):
            for side, ones in self._side_sensitivities(q, p):
                parts += [(p.get(side, 0.0) * sizes[place], one) for place, one in ones]
        return parts

    def _effect_twists(self, q: Sequence[Scalar], reached: Walk, p: Mapping[str, Scalar]) -> dict[str, Twist]:
        ones = zip(self.effect_parameters, self._sensitivities(q, p), strict=True)
        found = {name: self.twist_of(reached, one) for name, one in ones}
        for side, parts in self._side_sensitivities(q, p) if self.unknown_sides else ():
            shift, turn = ZERO, ZERO
            for place, one in parts:
                v, w = self.twist_of(reached, one)
                value = self.estimates[place]
                shift, turn = add(shift, scale(value, v)), add(turn, scale(value, w))
            found[side] = shift, turn
        return found

    def _sideless(self, effect: Effect) -> bool:
        """Whether an effect asks from which side its joint arrives, and no task says it."""
        return "approach" in effect.needs and effect.target not in self.inputs.stated

    @staticmethod
    def _stacked(twists: Sequence[Twist]) -> Any:
        return stack(list(zip(*((*v, *w) for v, w in twists), strict=True)))


def reshaped(effect: Effect, deviation: float) -> Effect:
    """An effect whose smooth shape deviates by so much, of its logarithm where errors of it are relative."""
    value = float(getattr(effect, effect.smooth_shape))
    return effect.with_shape(value * math.exp(deviation) if effect.relative_shape else value + deviation)


def shape_deviation(known: Effect, effect: Effect) -> float:
    """By how much the smooth shape of an effect deviates from that of one of its kind, see `reshaped`."""
    one, other = (float(getattr(e, effect.smooth_shape)) for e in (known, effect))
    return math.log(other / one) if effect.relative_shape else other - one


def _turned(turn: Vector, column: Vector) -> Vector:
    first = cross(turn, column)
    return add(add(column, first), scale(0.5, cross(turn, first)))


def split(values: Any, size: int, what: str) -> Sequence[Any]:
    """The ``size`` entries of a vector: of an SX, a sequence, or an array whose last axis has that size."""
    if isinstance(values, ca.SX | ca.MX | ca.DM):
        entries: Sequence[Any] = ca.vertsplit(ca.vec(values))
        if isinstance(values, ca.DM):
            entries = [float(entry) for entry in entries]
    elif isinstance(values, list | tuple) and any(isinstance(v, ca.SX | ca.MX) for v in values):
        entries = values
    else:
        array = np.asarray(values, dtype=float)
        entries = [float(v) for v in array] if array.ndim == 1 else [array[..., k] for k in range(array.shape[-1])]
    if len(entries) != size:
        raise ValueError(f"{what}: {len(entries)} values given, {size} expected")
    return entries
