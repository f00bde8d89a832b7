"""Compliance of what the arm is mounted on."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import cross, dot, scale, subtract
from posture_opt.model.effects.base.catalogue_entry import Input
from posture_opt.model.effects.base.cause import Size, compliance_size
from posture_opt.model.effects.base.effect import NOT_NEGATIVE, Sensitivity, SoleEffect


class BaseCompliance(SoleEffect):
    """``φ = c M``: the base turns about the overturning moment of links and payload about the first joint's foot.

    M is the moment [N m] of all weights without its vertical part; φ [rad] turns everything behind the foot.
    """

    summary: ClassVar[str] = "the base tilts under the overturning moment"
    phrase: ClassVar[str] = "the base is compliant: it tilts under the weight of the arm"
    measurement: ClassVar[str] = "measure targets fixed to the base in every posture"
    inspection: ClassVar[str] = "mounting bolts of the base, pedestal and floor under it"
    sole: ClassVar[str] = "base"
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("compliance", "angle per torque"),)
    limits: ClassVar[tuple[float, float]] = NOT_NEGATIVE
    needs: ClassVar[frozenset[Input]] = frozenset({"masses"})

    kind: Literal["base_compliance"] = "base_compliance"

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """Turn (3,) [rad/(N m)] per unit of ``compliance`` and the shift of the tool point that follows, ``φ × (x −
        foot)``.
        """
        foot = state.walk.screws[len(state.robot.base)].origin
        moment = state.moment(-1, foot)
        g = state.robot.gravity
        turn = subtract(moment, scale(dot(moment, g) / dot(g, g), g))
        return (Sensitivity(twist=(cross(turn, subtract(state.tool, foot)), turn)),)

    def size(self, name: str, dimension: str, value: float, std: float) -> Size:
        """The compliance with the stiffness that it is the inverse of."""
        return compliance_size(name, value, std)
