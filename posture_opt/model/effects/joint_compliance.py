"""Compliance of a joint under the torque of gravity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.catalogue_entry import Input
from posture_opt.model.effects.effect import Effect, Excitation, JointEffect


class JointCompliance(JointEffect):
    """``dq = c τ(q, m)``, τ the torque of gravity from links and payload.

    With ``loads: points`` the masses of the links are unknown and stand as point masses at the frames beyond the
    joint: ``dq = Σ_i θ_i τ_i(q) + c τ_payload``, τ_i the torque of 1 kg at frame i and θ_i compliance times mass.
    """

    summary: ClassVar[str] = "the joint gives way to the torque of gravity and payload"

    parameters: ClassVar = (("compliance", "angle per torque"),)

    kind: Literal["joint_compliance"] = "joint_compliance"
    loads: Literal["masses", "points"] = Field("masses", description="masses of the file, or unknown point masses")
    points: tuple[str, ...] = Field((), description="joints behind which unknown masses are, `tool` for the tool point")

    @property
    def dimensions(self) -> tuple[tuple[str, str], ...]:
        if self.loads == "masses":
            return self.parameters
        return tuple((f"mass at {name}", "angle mass per torque") for name in self.points)

    @property
    def asks(self) -> frozenset[Input]:
        return frozenset({"masses"}) if self.loads == "masses" else frozenset()

    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        if self.loads == "masses":
            return (site.torque(joint),)
        names = site.robot.joint_names
        places = [site.tool if p == "tool" else site.frames[names.index(p)].origin for p in self.points]
        return tuple(site.unit_torque(joint, place) for place in places)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        if "masses" in case.inputs:
            return [cls(joint=name) for name in case.moving("revolute")]
        return []
