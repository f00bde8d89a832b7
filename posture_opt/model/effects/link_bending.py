"""Bending of a link under the weight of all that it carries."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from posture_opt.errors import BadValueError
from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Vector, add, cross, dot, scale, subtract
from posture_opt.model.effects.base.catalogue_entry import Input
from posture_opt.model.effects.base.cause import Size, compliance_size
from posture_opt.model.effects.base.effect import NOT_NEGATIVE, Effect, Excitation, Sensitivity
from posture_opt.model.effects.base.joint_effect import EffectOfJoint
from posture_opt.robot.robot import Robot

_MIN_LINK_LENGTH_M = 0.02
"""A link shorter than this has nothing to bend."""


class LinkBending(EffectOfJoint):
    """``φ = c M⊥``: the end of the link behind the joint turns about the part of the moment across the link.

    M is the moment [N m] of all weights beyond, about the end of the link; a cantilever that turns by φ at its end is
    shifted there by ``φ × ℓ / 2``, ℓ from one end of the link to the other.
    """

    summary: ClassVar[str] = "the link behind the joint bends under the weight that it carries"
    phrase: ClassVar[str] = "the link behind {target} bends under gravity"
    measurement: ClassVar[str] = "measure the orientation of the tool too, under two payloads"
    inspection: ClassVar[str] = "the link behind {target}: cracks, and the flange bolts at both ends"
    rivals: ClassVar[Mapping[str, str]] = {"base_compliance": "measure targets fixed to the base in every posture"}
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("compliance", "angle per torque"),)
    limits: ClassVar[tuple[float, float]] = NOT_NEGATIVE
    types: ClassVar[tuple[str, ...]] = ("revolute", "prismatic")
    needs: ClassVar[frozenset[Input]] = frozenset({"masses"})

    kind: Literal["link_bending"] = "link_bending"

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """Turn (3,) [rad/(N m)] of the end of the link, and the shift of the tool point ``φ × (ℓ/2 + x − end)``."""
        joint = state.robot.joint_names.index(self.joint)
        start, end = _link_ends(state, joint)
        link = subtract(end, start)
        square = dot(link, link) + _MIN_LINK_LENGTH_M**2 * 1e-6
        moment = state.moment(joint, end)
        turn = subtract(moment, scale(dot(moment, link) / square, link))
        shift = add(cross(turn, scale(0.5, link)), cross(turn, subtract(state.tool, end)))
        return (Sensitivity(twist=(shift, turn)),)

    def size(self, name: str, dimension: str, value: float, std: float) -> Size:
        """The compliance with the stiffness that it is the inverse of."""
        return compliance_size(name, value, std)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        """Every link but the last that is longer than `_MIN_LINK_LENGTH_M`, where the masses are known."""
        if not cls.needs <= case.inputs:
            return []
        state = ArmState(case.robot, [0.0] * case.robot.n)
        names = case.robot.joint_names[:-1]
        return [cls(joint=name) for i, name in enumerate(names) if _link_length(state, i) > _MIN_LINK_LENGTH_M]

    def check_robot(self, robot: Robot) -> None:
        """Refuse a joint that the robot lacks, or the last one.

        Raises:
            BadValueError: no such joint, or no joint behind it, so that the end of its link is not known.
        """
        if robot.joint_names and self.joint == robot.joint_names[-1]:
            raise BadValueError(f"no joint follows {self.joint}, so the end of its link is not known")
        super().check_robot(robot)


def _link_ends(state: ArmState, joint: int) -> tuple[Vector, Vector]:
    """Where the link behind a joint begins and ends (3,), (3,) [m], world: on its axis and on the next one."""
    return state.axis(joint)[1], state.axis(joint + 1)[1]


def _link_length(state: ArmState, joint: int) -> float:
    """Distance [m] of the two points on the axes."""
    start, end = _link_ends(state, joint)
    return math.hypot(*subtract(end, start))
