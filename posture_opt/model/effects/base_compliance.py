"""Compliance of what the arm stands on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from posture_opt.model.chain import cross, dot, scale, subtract
from posture_opt.model.effects.effect import Case, Effect, Move
from posture_opt.model.site import Site


class BaseCompliance(Effect):
    """``φ = c M``: the base turns about the overturning moment of links and payload about the first joint's foot."""

    summary: ClassVar[str] = "the base tilts under the overturning moment"
    parameters: ClassVar = (("compliance", "angle per torque"),)
    needs: ClassVar = frozenset({"masses"})

    kind: Literal["base_compliance"] = "base_compliance"
    base: Literal["base"] = "base"

    @property
    def target(self) -> str:
        return "base"

    def moves(self, site: Site) -> tuple[Move, ...]:
        foot = site.walk.screws[len(site.robot.base)].origin
        moment = site.moment(-1, foot)
        g = site.robot.gravity
        turn = subtract(moment, scale(dot(moment, g) / dot(g, g), g))
        return (Move(twist=(cross(turn, subtract(site.tool, foot)), turn)),)

    @classmethod
    def candidates(cls, case: Case) -> Sequence[Effect]:
        return [cls()] if cls.needs <= case.inputs else []
