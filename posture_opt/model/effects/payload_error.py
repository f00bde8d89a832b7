"""A payload that weighs more or less than stated."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.effects.effect import Sensitivity, SoleEffect


class PayloadError(SoleEffect):
    """``dq_j = e τ_j(payload)`` in all joints: the sag under a payload whose weight is misstated.

    e is the common compliance of the joints times the relative error of the mass; only the product shows.
    """

    summary: ClassVar[str] = "the sag in proportion to the payload is more or less than the model's"
    sole: ClassVar = "payload"
    parameters: ClassVar = (("sag", "angle per torque"),)
    needs: ClassVar = frozenset({"payload"})

    kind: Literal["payload_error"] = "payload_error"

    def moves(self, site: ArmState) -> tuple[Sensitivity, ...]:
        turning = [i for i, joint in enumerate(site.robot.joints) if joint.type == "revolute"]
        return (Sensitivity({i: site.payload_torque(i) for i in turning}),)
