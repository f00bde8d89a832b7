"""``Arm``: the symbolic forward model ``pose = fk(q, p, u)`` that everything else is derived from.

Conventions: ``T_world_tool`` maps tool coordinates to the world; twists are ``(v, ω)``, linear first, in world axes at
the tool point; positions in [m], angles in [rad]. NumPy batches have the batch axis first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import casadi as ca
import numpy as np

from posture_opt.model.arm_state import ActingEffects, Inputs, MeasuredRange, Weighted
from posture_opt.model.chain import (
    ZERO,
    Scalar,
    Stacked,
    Values,
    Vector,
    Walk,
    add,
    displaced,
    factor_values,
    position_column,
    rotation_column,
    scale,
    split,
    stack,
    walk,
)
from posture_opt.numerics import TURN, Array
from posture_opt.robot.robot import Robot

if TYPE_CHECKING:  # a plain chain needs none of the effects, which are many files
    from posture_opt.model.effects.base.effect import Effect, Sensitivity

# Shift (3,) [m] of the tool point and small rotation (3,) [rad] of the tool (v, ω), world axes, per unit of a parameter
Twist = tuple[Vector, Vector]


class HasArm(Protocol):
    """Anything that names an arm, such as a ``Problem``."""

    @property
    def arm(self) -> Arm: ...


@dataclass(frozen=True)
class Reached:
    """The chain with its effects at one posture, or at N of them."""

    walk: Walk  # pose of the tool and the screw of every factor
    values: list[Scalar]  # the value of every factor, effects included [rad or m]
    shift: Vector  # (3,) what effects add to the tool point behind the chain, world [m]
    ones: Sequence[Sensitivity] = ()  # what one unit of each parameter of the effects does there


@dataclass(frozen=True)
class Arm:
    """The forward model of a robot with effects: joints ``q``, named parameters ``p`` and inputs in, tool pose out.

    ``parameters`` fixes the order of ``p``: geometry and frames from the base to the tool, then those of the effects.
    Every parameter is a deviation: from the nominal value of the geometry, from the estimate of an effect.

    All methods take CasADi expressions, numbers, or arrays (N,) of them, and return the like, in m, rad and world axes.

    The pose is the product of the chain's factors, ``T_world_tool = Π_i F_i(nominal_i + p_i + q_i)``, each a rotation
    about an axis or a shift along one, changed by what the effects add to joints, lengths and the tool.

    Args:
        robot: the nominal chain.
        effects: with their estimates; none for a plain chain.
        inputs: payload, temperature, time and sides of approach under which the effects act.

    Example:
        >>> from posture_opt import load_problem
        >>> arm = Arm.from_problem(load_problem("insert_planar_2r"))
        >>> arm.position([0.0, 0.0]).tolist()
        [2.0, 0.0, 0.0]
        >>> arm.jacobian([0.0, 0.0])[:2].tolist()
        [[0.0, 0.0], [2.0, 1.0]]
    """

    robot: Robot
    effects: tuple[Effect, ...] = ()
    inputs: Inputs = field(default_factory=Inputs, compare=False)

    @classmethod
    def from_problem(cls, problem: HasArm) -> Arm:
        """The arm of a problem.

        Args:
            problem: a ``Problem``, whose task states payload, temperature and sides of approach.
        """
        return problem.arm

    def under(self, inputs: Inputs) -> Arm:
        """The same arm under other inputs; parameters keep their order."""
        return replace(self, inputs=inputs)

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """(k,) names of the model parameters, from the base to the tool, then those of the effects."""
        return (*self.robot.parameters, *self.effect_parameters)

    @property
    def effect_parameters(self) -> tuple[str, ...]:
        """(e,) names of the parameters of all effects, ``kind(target).parameter``."""
        return self._acting_effects.parameters

    @property
    def shape_parameters(self) -> dict[str, int]:
        """``kind(target).shape`` of every effect that depends smoothly on its shape, and its place in ``effects``.

        They are parameters for a fit alone: deviations of the shape, of its logarithm where errors of it are relative.
        """
        return self._acting_effects.shapes

    @property
    def unknown_sides(self) -> tuple[str, ...]:
        """``JOINT.side`` of every joint of an effect whose side of arrival no task states: −1 or +1 alike."""
        return self._acting_effects.unknown_sides

    @property
    def measured_ranges(self) -> tuple[MeasuredRange, ...]:
        """The effects that are not known at all values that their joint may take, with the range in which they are."""
        return tuple(self._acting_effects.ranges.values())

    def beyond_measured(self, Q: Array) -> tuple[MeasuredRange, ...]:
        """Those of them that some of the postures Q (N, n) [rad or m] leave."""
        columns = list(np.atleast_2d(np.asarray(Q, dtype=float)).T)
        return tuple(found for found in self.measured_ranges if not np.all(found.inside(columns)))

    @property
    def unit_sources(self) -> tuple[str, ...]:
        """Errors of variance 1 that effects bring along: unknown sides, and what is not known beyond a range."""
        return (*self.unknown_sides, *(found.name for found in self.measured_ranges))

    def for_fit(self) -> Arm:
        """The same arm with effects known everywhere: data say themselves where an effect is as it is stated."""
        return replace(self, effects=tuple(effect.known_everywhere() for effect in self.effects))

    def within_measured(self) -> Arm:
        """The same arm with the joints kept within the ranges that their effects were measured in.

        A joint that cannot be there at all, by its limits, stays as it is.
        """
        joints = list(self.robot.joints)
        for found in self.measured_ranges:
            joint = joints[found.joint]
            low, high = max(joint.lower, found.low), min(joint.upper, found.high)
            if low < high:
                joints[found.joint] = replace(joint, lower=low, upper=high)
        return replace(self, robot=replace(self.robot, joints=tuple(joints))) if self.measured_ranges else self

    def in_measured_turn(self) -> Arm:
        """The same arm with every joint that turns more than once kept to one turn, with the range of its effects.

        A whole turn away the tool is in the same place, and nothing of what was measured holds. It is the turn about
        zero where that has the whole range, else the one about the range.
        """
        joints, ranges = list(self.robot.joints), self.measured_ranges
        for k in {found.joint for found in ranges}:
            joint, mine = joints[k], [found for found in ranges if found.joint == k]
            if joint.type == "revolute" and joint.upper - joint.lower > TURN:
                least, most = min(found.low for found in mine), max(found.high for found in mine)
                middle = 0.0 if max(-least, most) <= TURN / 2 else (least + most) / 2
                low = min(max(middle - TURN / 2, joint.lower), joint.upper - TURN)
                joints[k] = replace(joint, lower=low, upper=low + TURN)
        return replace(self, robot=replace(self.robot, joints=tuple(joints))) if ranges else self

    @cached_property
    def dimensions(self) -> dict[str, str]:
        """Parameter of an effect -> its dimension, a key of ``units.DIMENSIONS`` or ``ratio``."""
        return {
            name: dimension
            for effect in self.effects
            for name, (_, dimension) in zip(effect.parameter_names, effect.dimensions, strict=True)
        }

    @cached_property
    def q(self) -> ca.SX:
        """(n,) joint symbols [rad or m]."""
        return ca.SX.sym("q", self.robot.n)

    def walk(self, q: Values, p: Values | None = None) -> Walk:
        """The walk along the chain: pose and screws as scalars.

        Args:
            q: (n,) or (N, n) commanded joints [rad or m].
            p: (k,) deviations in the order of `parameters` [SI]; none for the nominal arm.

        Raises:
            ValueError: vectors of another length.
        """
        named: dict[str, Scalar] = {}
        if p is not None:
            named = dict(zip(self.parameters, split(p, len(self.parameters), "parameters"), strict=True))
        return self.reach(split(q, self.robot.n, "posture"), named).walk

    def pose(self, q: Values, p: Values | None = None) -> Stacked:
        """``T_world_tool`` (4, 4), lengths in [m]: a CasADi expression where ``q`` or ``p`` is one, else an array (N,
        4, 4).

        Args:
            q: (n,) or (N, n) commanded joints [rad or m].
            p: (k,) deviations in the order of `parameters` [SI]; none for the nominal arm.

        Raises:
            ValueError: vectors of another length.
        """
        reached = self.walk(q, p)
        (r0, r1, r2), x = reached.columns, reached.position
        return stack([(r0[k], r1[k], r2[k], x[k]) for k in range(3)] + [(0.0, 0.0, 0.0, 1.0)])

    def position(self, q: Values, p: Values | None = None) -> Stacked:
        """The tool point (3,) or (N, 3) in the world [m]; ``q`` and ``p`` as of `pose`."""
        return stack(self.walk(q, p).position)

    def jacobian(self, q: Values, p: Values | None = None) -> Stacked:
        """The geometric Jacobian (6, n) of the tool point, rows ``(v, ω)``, world-aligned axes.

        ``∂x/∂q_j = a_j × (x − o_j)`` for a joint that turns about the axis a_j through o_j, ``a_j`` for one that
        slides: [m/rad, m/m], below that [rad/rad, rad/m]. ``q`` and ``p`` as of `pose`; of the commanded joints,
        without effects.
        """
        driven = [self.robot.factors[i].parameter or i for i in self.robot.driven]
        return self._stacked_twists(self.twists(driven, split(q, self.robot.n, "posture"), self.walk(q, p)))

    def parameter_jacobian(self, q: Values, p: Values | None = None) -> Stacked:
        """``∂(x, φ)/∂p`` (6, k): tool-point shift and small rotation per parameter [SI], world-aligned axes.

        At the posture ``q`` and the deviations ``p`` of the chain, as of `pose`; of effects to first order in their
        size.
        """
        joints = split(q, self.robot.n, "posture")
        return self._stacked_twists(self.twists(self.parameters, joints, self.walk(q, p)))

    def reach(self, q: Sequence[Scalar], p: Mapping[str, Scalar] | None = None) -> Reached:
        """Where the chain with its effects brings the tool.

        Joint and length increments of effects enter the chain itself; what they shift and turn at the end is added
        behind it, to second order in the turn. Effects act as on the arm without them, in the geometry that ``p``
        states.

        Args:
            q: (n,) commanded joints [rad or m].
            p: deviations of named parameters, those of effects and unknown sides among them.
        """
        robot, p = self.robot, p or {}
        values = factor_values(robot.factors, q, p)
        if not self.effects:
            return Reached(walk(robot.factors, values), values, ZERO)
        shift, turn = ZERO, ZERO
        ones = self._acting_effects.sensitivities(q, p)
        for size, one in self._acting_effects.in_size(q, p, ones):
            for index, increment in self._factor_increments(one):
                values[index] = values[index] + size * increment
            v, w = one.twist
            shift = shift if v is ZERO else add(shift, scale(size, v))
            turn = turn if w is ZERO else add(turn, scale(size, w))
        return Reached(displaced(walk(robot.factors, values), shift, turn), values, shift, ones)

    def twists(
        self, names: Iterable[str | int], q: Sequence[Scalar], reached: Walk, p: Mapping[str, Scalar] | None = None,
        ones: Sequence[Sensitivity] = (),
    ) -> list[Twist]:  # fmt: skip
        """Sensitivity of the tool to named parameters: shift of its point and small rotation per unit of each.

        For a factor with the axis a and the origin o: ``(a × (x − o), a)`` if it rotates, else ``(a, 0)``; for a
        parameter of an effect the sum of what it adds to joints, lengths and behind the chain, to first order. This
        is the only place where a column is made: of geometry, frames, joint values, effects and sides alike.

        Args:
            names: of parameters, of `unknown_sides`, or indices into ``robot.factors``.
            q: (n,) commanded joints [rad or m].
            reached: the walk there.
            p: the deviations that the effects act under.
            ones: of the `Reached` there, where it is at hand.
        """
        factors, found = self._factor_index, []
        units: dict[str, Weighted] = {}
        for name in names:
            index = name if isinstance(name, int) else factors.get(name)
            if index is not None:
                found.append((position_column(reached, index), rotation_column(reached, index)))
                continue
            if name in self.shape_parameters:
                parts = self._acting_effects.per_shape(str(name), q, p or {})
            else:
                units = units or self._acting_effects.per_unit(q, p or {}, ones)
                parts = units[str(name)]
            found.append(self._weighted_twist(reached, parts))
        return found

    def twist_of(self, reached: Walk, one: Sensitivity) -> Twist:
        """Shift (3,) and small rotation (3,) by one unit of what an effect does, world axes."""
        shift, turn = one.twist
        for index, size in self._factor_increments(one):
            shift = add(shift, scale(size, position_column(reached, index)))
            turn = add(turn, scale(size, rotation_column(reached, index)))
        return shift, turn

    def carried(self, q: Sequence[Scalar]) -> dict[int, Scalar]:
        """Joint index -> how far joints are off their commands ``q`` (n,) as others carry them along [rad]."""
        return self._acting_effects.carried(q)

    @cached_property
    def _acting_effects(self) -> ActingEffects:
        return ActingEffects(self.robot, self.effects, self.inputs)

    @cached_property
    def _factor_index(self) -> dict[str, int]:
        """Name of a geometric parameter -> index of its factor in ``robot.factors``."""
        return {f.parameter: i for i, f in enumerate(self.robot.factors) if f.parameter}

    def _weighted_twist(self, reached: Walk, parts: Weighted) -> Twist:
        """The weighted sum of what the parts do: shift (3,) and small rotation (3,), world axes."""
        shift, turn = ZERO, ZERO
        for weight, one in parts:
            v, w = self.twist_of(reached, one)
            shift, turn = add(shift, scale(weight, v)), add(turn, scale(weight, w))
        return shift, turn

    def _factor_increments(self, one: Sensitivity) -> list[tuple[int, Scalar]]:
        """(index of a factor, increment [rad or m]) of everything that one unit adds to the chain."""
        driven = self.robot.driven if one.joints else ()
        parts = [(driven[joint], size) for joint, size in one.joints.items()]
        return parts + [(self._factor_index[name], size) for name, size in one.lengths.items()]

    @staticmethod
    def _stacked_twists(twists: Sequence[Twist]) -> Stacked:
        """(6, k) twists side by side, rows ``(v, ω)``."""
        return stack(list(zip(*((*v, *w) for v, w in twists), strict=True)))
