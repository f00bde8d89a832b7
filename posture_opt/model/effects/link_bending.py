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
from posture_opt.model.effects.base.effect import POSITIVE, Effect, Excitation, Sensitivity
from posture_opt.model.effects.base.joint_effect import EffectOfJoint
from posture_opt.robot.robot import Robot

_SHORT = 0.02  # m; a link shorter than this has nothing to bend


class LinkBending(EffectOfJoint):
    """``φ = c M⊥``: the end of the link behind the joint turns about the part of the moment across the link.

    M is the moment of all weights beyond, about the end of the link; a cantilever that turns by φ at its end is
    shifted there by ``φ × ℓ / 2``, ℓ from one end of the link to the other.
    """

    summary: ClassVar[str] = "the link behind the joint bends under the weight that it carries"
    phrase: ClassVar[str] = "the link behind {target} bends under gravity"
    measurement: ClassVar[str] = "measure the orientation of the tool too, under two payloads"
    rivals: ClassVar[Mapping[str, str]] = {"base_compliance": "measure targets fixed to the base in every posture"}
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("compliance", "angle per torque"),)
    limits: ClassVar[tuple[float, float]] = POSITIVE
    types: ClassVar[tuple[str, ...]] = ("revolute", "prismatic")
    needs: ClassVar[frozenset[Input]] = frozenset({"masses"})

    kind: Literal["link_bending"] = "link_bending"

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        joint = state.robot.joint_names.index(self.joint)
        start, end = _ends(state, joint)
        link = subtract(end, start)
        square = dot(link, link) + _SHORT**2 * 1e-6
        moment = state.moment(joint, end)
        turn = subtract(moment, scale(dot(moment, link) / square, link))
        shift = add(cross(turn, scale(0.5, link)), cross(turn, subtract(state.tool, end)))
        return (Sensitivity(twist=(shift, turn)),)

    def size(self, name: str, dimension: str, value: float, std: float) -> Size:
        return compliance_size(name, value, std)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        if not cls.needs <= case.inputs:
            return []
        state = ArmState(case.robot, [0.0] * case.robot.n)
        names = case.robot.joint_names[:-1]
        return [cls(joint=name) for i, name in enumerate(names) if _length(state, i) > _SHORT]

    def check_robot(self, robot: Robot) -> None:
        if robot.joint_names and self.joint == robot.joint_names[-1]:
            raise BadValueError(f"no joint follows {self.joint}, so the file does not tell where its link ends")
        super().check_robot(robot)


def _ends(state: ArmState, joint: int) -> tuple[Vector, Vector]:
    """Where the link behind a joint begins and ends: at its axis and at the next one."""
    return state.axis(joint)[1], state.axis(joint + 1)[1]


def _length(state: ArmState, joint: int) -> float:
    start, end = _ends(state, joint)
    return math.hypot(*subtract(end, start))
