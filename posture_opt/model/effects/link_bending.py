"""Bending of a link under the weight of all that it carries."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from posture_opt.model.chain import Scalar, add, cross, dot, scale, subtract
from posture_opt.model.effects.effect import JointEffect, Move
from posture_opt.model.site import Site

_SHORT = 0.02  # m; a link shorter than this has nothing to bend


class LinkBending(JointEffect):
    """``φ = c M⊥``: the end of the link behind the joint turns about the part of the moment across the link.

    M is the moment of all weights beyond, about the end of the link; a cantilever that turns by φ at its end is
    shifted there by ``φ × ℓ / 2``, ℓ from one end of the link to the other.
    """

    summary: ClassVar[str] = "the link behind the joint bends under the weights that it carries"
    parameters: ClassVar = (("compliance", "angle per torque"),)
    types: ClassVar = ("revolute", "prismatic")
    needs: ClassVar = frozenset({"masses"})

    kind: Literal["link_bending"] = "link_bending"

    def features(self, site: Site, joint: int) -> tuple[Scalar, ...]:
        raise NotImplementedError  # it is no joint that moves

    def moves(self, site: Site) -> tuple[Move, ...]:
        joint = site.robot.joint_names.index(self.joint)
        start, end = site.axis(joint)[1], site.frames[joint].origin
        link = subtract(end, start)
        square = dot(link, link) + _SHORT**2 * 1e-6
        moment = site.moment(joint, end)
        turn = subtract(moment, scale(dot(moment, link) / square, link))
        shift = add(cross(turn, scale(0.5, link)), cross(turn, subtract(site.tool, end)))
        return (Move(twist=(shift, turn)),)

    @classmethod
    def candidates(cls, case):  # type: ignore[no-untyped-def]
        if not cls.needs <= case.inputs:
            return []
        return [
            cls(joint=name) for i, name in enumerate(case.robot.joint_names[:-1]) if _length(case.robot, i) > _SHORT
        ]


def _length(robot, joint: int) -> float:  # type: ignore[no-untyped-def]
    return math.hypot(*(f.nominal for f in robot.links[joint] if f.kind == "translate"))
