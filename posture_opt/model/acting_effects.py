"""``ActingEffects``: the effects of an arm under its inputs, their parameters, and what these do at a posture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from posture_opt.model.arm_state import ArmState, Inputs
from posture_opt.model.chain import Scalar
from posture_opt.robot.robot import Robot

if TYPE_CHECKING:  # a plain chain needs none of the effects, which are many files
    from posture_opt.model.effects.base.effect import Effect, Sensitivity

Weighted = list[tuple[Scalar, "Sensitivity"]]
"""A sum of sensitivities, each with its weight in the unit of its parameter [SI]."""

_SHAPE_STEP = 1e-3
"""Step of central differences by a shape, in its own or its logarithm's unit: the derivative is good to 1e-6 of
itself.
"""


@dataclass(frozen=True)
class ActingEffects:
    """Effects of a robot with the sizes of their estimates, under inputs that say how far they act.

    Args:
        robot: the chain that they act on.
        effects: with their estimates; none for a plain chain.
        inputs: payload, temperature, time and sides of approach under which the effects act.
    """

    robot: Robot
    effects: tuple[Effect, ...]
    inputs: Inputs

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
    def estimates(self) -> tuple[float, ...]:
        """(e,) the estimates of the effects, in the order of `parameters` [SI]."""
        return tuple(value for effect in self.effects for value in effect.values)

    def in_size(self, q: Sequence[Scalar], p: Mapping[str, Scalar]) -> Weighted:
        """What all effects do, each with the size of its parameter: the estimate and its deviation in ``p``.

        Args:
            q: (n,) commanded joints [rad or m]: numbers, arrays (N,) or CasADi expressions.
            p: name -> deviation [SI], of geometry, effects, shapes and unknown sides (−1 or +1).

        Returns:
            Pairs of a size and what one unit of it does, to be summed.
        """
        sizes = [v + p.get(name, 0.0) for name, v in zip(self.parameters, self.estimates, strict=True)]
        parts = list(zip(sizes, self._sensitivities(q, p), strict=True))
        if any(side in p for side in self.unknown_sides):
            for side, ones in self._side_sensitivities(q, p).items():
                parts += [(p.get(side, 0.0) * sizes[place], one) for place, one in ones]
        return parts

    def per_unit(self, q: Sequence[Scalar], p: Mapping[str, Scalar]) -> dict[str, Weighted]:
        """What one unit of every parameter and of every unknown side does, to first order.

        Args:
            q: (n,) commanded joints [rad or m].
            p: deviations of the geometry and of shapes at which the derivative is taken [SI].
        """
        ones = zip(self.parameters, self._sensitivities(q, p), strict=True)
        found: dict[str, Weighted] = {name: [(1.0, one)] for name, one in ones}
        for side, parts in self._side_sensitivities(q, p).items() if self.unknown_sides else ():
            found[side] = [(self.estimates[place], one) for place, one in parts]
        return found

    def per_shape(self, name: str, q: Sequence[Scalar], p: Mapping[str, Scalar]) -> Weighted:
        """The derivative by a shape: central differences of what its effect does with its present size.

        Args:
            name: a key of `shapes`.
            q: (n,) commanded joints [rad or m].
            p: deviations [SI], that of the shape among them; numbers only, as a shape is no symbol.
        """
        place = self.shapes[name]
        first = sum(len(effect.dimensions) for effect in self.effects[:place])
        state, at, found = self._bare_state(q, p, self.inputs), float(p.get(name, 0.0)), []
        for step in (_SHAPE_STEP, -_SHAPE_STEP):
            for k, one in enumerate(self.effects[place].reshaped(at + step).sensitivities(state), first):
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

    def _sensitivities(self, q: Sequence[Scalar], p: Mapping[str, Scalar]) -> list[Sensitivity]:
        """(e,) what each parameter does, of effects with the shapes that ``p`` states."""
        effects = list(self.effects)
        for name, i in self.shapes.items():
            if name in p:
                effects[i] = effects[i].reshaped(float(p[name]))
        state = self._bare_state(q, p, self.inputs)
        return [one for effect in effects for one in effect.sensitivities(state)]

    def _side_sensitivities(
        self, q: Sequence[Scalar], p: Mapping[str, Scalar]
    ) -> dict[str, list[tuple[int, Sensitivity]]]:
        """For each unknown side what arriving from above (+1) does: index of the parameter, and what one unit of it
        does.
        """
        state = self._bare_state(q, p, replace(self.inputs, approach=[1.0] * self.robot.n))
        found: dict[str, list[tuple[int, Sensitivity]]] = {side: [] for side in self.unknown_sides}
        place = 0
        for effect in self.effects:
            if self._lacks_side(effect):
                found[f"{effect.target}.side"] += enumerate(effect.sensitivities(state), place)
            place += len(effect.dimensions)
        return found

    def _lacks_side(self, effect: Effect) -> bool:
        """Whether an effect depends on the side from which its joint arrives, and no task states it."""
        return "approach" in effect.needs and effect.target not in self.inputs.stated
