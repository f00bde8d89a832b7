"""``Extension``: the effects that a robot's forward model is extended by, with the inputs under which it works."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from posture_opt.model.arm_state import ZERO, ArmState
from posture_opt.model.chain import Scalar, Vector, Walk, add, cross, factor_values, scale, walk
from posture_opt.model.derivatives import position_column, rotation_column
from posture_opt.model.inputs import Inputs
from posture_opt.robot.robot import Robot

if TYPE_CHECKING:  # a plain chain needs none of them
    from posture_opt.model.effects.effect import Effect, Sensitivity

Twist = tuple[Vector, Vector]


@dataclass(frozen=True, eq=False)
class Extension:
    """Effects with their estimates, and the inputs that a task states for them."""

    effects: tuple[Effect, ...]
    inputs: Inputs = field(default_factory=Inputs)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of all parameters of the effects."""
        return tuple(name for effect in self.effects for name in effect.parameter_names)

    @cached_property
    def dimensions(self) -> dict[str, str]:
        """The dimension of every parameter."""
        pairs = [
            (name, dimension)
            for effect in self.effects
            for name, (_, dimension) in zip(effect.parameter_names, effect.dimensions, strict=True)
        ]
        return dict(pairs)

    @cached_property
    def values(self) -> tuple[float, ...]:
        """The estimates, in the order of `names` [SI]."""
        return tuple(value for effect in self.effects for value in effect.values)

    @cached_property
    def sides(self) -> tuple[str, ...]:
        """``JOINT.side`` of every joint of an effect that arrives no one knows from where: −1 or +1 with equal odds."""
        joints = [effect.target for effect in self.effects if self._unknown_side(effect)]
        return tuple(f"{joint}.side" for joint in dict.fromkeys(joints))

    def moves(self, robot: Robot, q: Sequence[Scalar]) -> list[Sensitivity]:
        """What one unit of each parameter does at ``q``."""
        site = ArmState(robot, q, self.inputs)
        return [move for effect in self.effects for move in effect.moves(site)]

    def side_moves(self, robot: Robot, q: Sequence[Scalar]) -> list[list[tuple[int, Sensitivity]]]:
        """For each of `sides` what arriving from above does: place in `names` and move of each parameter."""
        site = ArmState(robot, q, replace(self.inputs, approach=[1.0] * robot.n))
        found: list[list[tuple[int, Sensitivity]]] = [[] for _ in self.sides]
        place = 0
        for effect in self.effects:
            if self._unknown_side(effect):
                found[self.sides.index(f"{effect.target}.side")] += enumerate(effect.moves(site), place)
            place += len(effect.dimensions)
        return found

    def _unknown_side(self, effect: Effect) -> bool:
        """Whether an effect asks from which side its joint arrives, and no task says it."""
        return "approach" in effect.needs and effect.target not in self._stated

    @cached_property
    def _stated(self) -> frozenset[str]:
        return frozenset(self.inputs.stated)


def forward(
    robot: Robot, q: Sequence[Scalar], p: Mapping[str, Scalar] | None = None
) -> tuple[Walk, list[Scalar], Vector]:
    """The walk along a robot's chain with its effects, the values of its factors, and the shift at its end.

    Joint and length increments enter the chain itself; what effects shift and turn at the end is added behind it, to
    second order in the turn.

    Args:
        q: (n,) commanded joints; p: deviations of named parameters, those of effects and unknown sides among them.
    """
    values = factor_values(robot.factors, q, p)
    extension: Extension | None = robot.extension
    if extension is None or not extension.effects:
        return walk(robot.factors, values), values, ZERO
    shift, turn = ZERO, ZERO
    at = {f.parameter: i for i, f in enumerate(robot.factors) if f.parameter}
    for size, move in _sized(robot, extension, q, p or {}):
        for joint, increment in move.joints.items():
            values[robot.driven[joint]] = values[robot.driven[joint]] + size * increment
        for name, increment in move.lengths.items():
            values[at[name]] = values[at[name]] + size * increment
        if move.twist[0] is not ZERO:
            shift = add(shift, scale(size, move.twist[0]))
        if move.twist[1] is not ZERO:
            turn = add(turn, scale(size, move.twist[1]))
    reached = walk(robot.factors, values)
    if shift is ZERO and turn is ZERO:
        return reached, values, ZERO
    columns = reached.columns if turn is ZERO else tuple(_turned(turn, column) for column in reached.columns)
    return Walk(columns, add(reached.position, shift), reached.screws), values, shift  # type: ignore[arg-type]


def _sized(
    robot: Robot, extension: Extension, q: Sequence[Scalar], p: Mapping[str, Scalar]
) -> list[tuple[Scalar, Sensitivity]]:
    """The moves of all effects, each with the size of its parameter."""
    sizes = [v + p.get(name, 0.0) for name, v in zip(extension.names, extension.values, strict=True)]
    parts = list(zip(sizes, extension.moves(robot, q), strict=True))
    if any(side in p for side in extension.sides):
        for side, moves in zip(extension.sides, extension.side_moves(robot, q), strict=True):
            parts += [(p.get(side, 0.0) * sizes[place], move) for place, move in moves]
    return parts


def _turned(turn: Vector, column: Vector) -> Vector:
    first = cross(turn, column)
    return add(add(column, first), scale(0.5, cross(turn, first)))


def twist_of(robot: Robot, reached: Walk, move: Sensitivity) -> Twist:
    """Shift of the tool point and small rotation of the tool by one unit of a move, world axes."""
    shift, turn = move.twist
    at = {f.parameter: i for i, f in enumerate(robot.factors) if f.parameter}
    parts: list[tuple[Any, int]] = [(size, robot.driven[joint]) for joint, size in move.joints.items()]
    parts += [(size, at[name]) for name, size in move.lengths.items()]
    for size, index in parts:
        shift = add(shift, scale(size, position_column(reached, index)))
        turn = add(turn, scale(size, rotation_column(reached, index)))
    return shift, turn


def extension_twists(robot: Robot, q: Sequence[Scalar], reached: Walk) -> tuple[list[Twist], list[Twist]]:
    """The twist per unit of every parameter of the effects, and that of every unknown side."""
    extension: Extension | None = robot.extension
    if extension is None:
        return [], []
    own = [twist_of(robot, reached, move) for move in extension.moves(robot, q)]
    sides = []
    for parts in extension.side_moves(robot, q):
        shift, turn = ZERO, ZERO
        for place, move in parts:
            v, w = twist_of(robot, reached, move)
            value = extension.values[place]
            shift, turn = add(shift, scale(value, v)), add(turn, scale(value, w))
        sides.append((shift, turn))
    return own, sides
