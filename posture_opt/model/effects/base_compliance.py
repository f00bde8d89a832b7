"""Compliance of what the arm stands on."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import cross, dot, scale, subtract
from posture_opt.model.effects.effect import Sensitivity, SoleEffect


class BaseCompliance(SoleEffect):
    """``φ = c M``: the base turns about the overturning moment of links and payload about the first joint's foot."""

    summary: ClassVar[str] = "the base tilts under the overturning moment"
    sole: ClassVar = "base"
    parameters: ClassVar = (("compliance", "angle per torque"),)
    needs: ClassVar = frozenset({"masses"})

    kind: Literal["base_compliance"] = "base_compliance"

    def moves(self, site: ArmState) -> tuple[Sensitivity, ...]:
        foot = site.walk.screws[len(site.robot.base)].origin
        moment = site.moment(-1, foot)
        g = site.robot.gravity
        turn = subtract(moment, scale(dot(moment, g) / dot(g, g), g))
        return (Sensitivity(twist=(cross(turn, subtract(site.tool, foot)), turn)),)
