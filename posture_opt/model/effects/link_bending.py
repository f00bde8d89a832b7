"""Bending of a link under the weight of all that it carries."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar, Literal

from posture_opt.errors import BadValueError
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Vector, add, cross, dot, scale, subtract
from posture_opt.model.effects.base.effect import Effect, Excitation, Sensitivity
from posture_opt.model.effects.base.joint_effect import EffectOfJoint, GravityLoaded
from posture_opt.model.effects.base.plausible_range import LARGEST_TURN, SOURCE, PlausibleRange, least_stiffness
from posture_opt.robot.robot import Robot
from posture_opt.units import number

_MIN_LINK_LENGTH_M = 0.02  # A link shorter than this has nothing to bend


class LinkBending(GravityLoaded, EffectOfJoint):
    """``φ = c M⊥``: the end of the link behind the joint turns about the part of the moment across the link.

    M is the moment [N m] of all weights beyond, about the end of the link; a cantilever that turns by φ at its end is
    shifted there by ``φ × ℓ / 2``, ℓ from one end of the link to the other.
    """

    summary: ClassVar[str] = "the link behind the joint bends under the weight that it carries"
    phrase: ClassVar[str] = "the link behind {target} bends under gravity"
    measurement: ClassVar[str] = "measure the orientation of the tool too, under two payloads"
    inspection: ClassVar[str] = "flange bolts at both ends of the {link}, against an equal arm; cracks last"
    rivals: ClassVar[Mapping[str, str]] = {"base_compliance": "measure targets fixed to the base in every posture"}
    yields: ClassVar[str] = "bends by"
    types: ClassVar[tuple[str, ...]] = ("revolute", "prismatic")

    kind: Literal["link_bending"] = "link_bending"

    def inspect(self, robot: Robot) -> str:
        return self.inspection.format(link=robot.link_words(self.target))

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """Turn (3,) [rad/(N m)] of the end of the link, and the shift of the tool point ``φ × (ℓ/2 + x − end)``."""
        joint = state.robot.joint_names.index(self.joint)
        start, end = _link_ends(state, joint)
        link = subtract(end, start)
        square = dot(link, link) + _MIN_LINK_LENGTH_M**2 * 1e-6
        found = []
        for moment in self.moments(state, joint, end):
            turn = subtract(moment, scale(dot(moment, link) / square, link))
            shift = add(cross(turn, scale(0.5, link)), cross(turn, subtract(state.tool, end)))
            found.append(Sensitivity(twist=(shift, turn)))
        return tuple(found)

    def plausible(self, robot: Robot) -> PlausibleRange | None:
        """As of the joint before it: a link is at least as stiff as its gear (Dumas, Caro, Garnier, Furet 2011)."""
        softest = least_stiffness(robot, robot.joint_names.index(self.joint))
        source = f"Dumas, Caro, Garnier, Furet 2011, and for the gear {SOURCE}"
        if self.unstated_loads:
            needs = "a link that bends by more than gears twist under the largest load that they are made for"
            return PlausibleRange(-LARGEST_TURN, LARGEST_TURN, "angle", needs, source)
        needs = f"a link softer than {number(softest / 1e3)} kN m/rad, softer than any gear that carries this load"
        return PlausibleRange(0.0, 1 / softest, "angle per torque", needs, source)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        return [cls(joint=name) for name in _long_links(case.robot)] if "masses" in case.inputs else []

    @classmethod
    def unknown_loads(cls, case: Excitation) -> Iterator[tuple[Effect, tuple[str, ...]]]:
        """Every such link, with the frames behind its end."""
        names = case.robot.joint_names
        for name in _long_links(case.robot):
            yield cls(joint=name, loads="points"), cls.frames_of_load(case, names.index(name) + 1)

    def check_robot(self, robot: Robot) -> None:
        """Refuse a joint that the robot lacks, or the last one."""
        if robot.joint_names and self.joint == robot.joint_names[-1]:
            raise BadValueError(f"no joint follows {self.joint}, so the end of its link is not known")
        super().check_robot(robot)


def _long_links(robot: Robot) -> list[str]:
    state = ArmState(robot, [0.0] * robot.n)
    ends = [_link_ends(state, i) for i in range(robot.n - 1)]
    return [
        name
        for name, (start, end) in zip(robot.joint_names, ends, strict=False)
        if math.hypot(*subtract(end, start)) > _MIN_LINK_LENGTH_M
    ]


def _link_ends(state: ArmState, joint: int) -> tuple[Vector, Vector]:
    """Where the link behind a joint begins and ends (3,), (3,) [m], world: on its axis and on the next one."""
    return state.axis(joint)[1], state.axis(joint + 1)[1]
