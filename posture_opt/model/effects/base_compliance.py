"""Compliance of what the arm is mounted on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import cross, dot, scale, subtract
from posture_opt.model.effects.base.effect import Effect, Excitation, Sensitivity, SoleEffect, foot
from posture_opt.model.effects.base.joint_effect import GravityLoaded


class BaseCompliance(GravityLoaded, SoleEffect):
    """``φ = c M``: the base turns about the overturning moment of links and payload about the first joint's foot.

    M is the moment [N m] of all weights without its vertical part; φ [rad] turns everything behind the foot. A column,
    or the bearing of a first joint that turns about the vertical, tilts in the same way.
    """

    summary: ClassVar[str] = "the base, or the column on it, tilts under the overturning moment"
    phrase: ClassVar[str] = "the base or the column on it is compliant: it tilts under the weight of the arm"
    measurement: ClassVar[str] = "measure targets fixed to the base in every posture"
    inspection: ClassVar[str] = "mounting bolts of the base, pedestal and floor under it"
    urgent: ClassVar[str] = "tighten the mounting bolts of the base: an arm that stands loose can tip"
    sole: ClassVar[str] = "base"
    yields: ClassVar[str] = "tilts by"

    kind: Literal["base_compliance"] = "base_compliance"

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """Turn (3,) [rad] per unit of each parameter and the shift of the tool point that follows, ``φ × (x −
        foot)``."""
        g, lever = state.robot.gravity, subtract(state.tool, foot(state))
        moments = self.moments(state, -1, foot(state))
        turns = [subtract(moment, scale(dot(moment, g) / dot(g, g), g)) for moment in moments]
        return tuple(Sensitivity(twist=(cross(turn, lever), turn)) for turn in turns)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        return [cls()] if "masses" in case.inputs else []

    @classmethod
    def unknown_loads(cls, case: Excitation) -> Iterator[tuple[Effect, tuple[str, ...]]]:
        """The one instance, with all frames."""
        yield cls(loads="points"), cls.frames_of_load(case, 0)
