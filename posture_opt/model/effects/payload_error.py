"""A payload that weighs more or less than stated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.effects.base.cause import Input
from posture_opt.model.effects.base.effect import Sensitivity, SoleEffect


class PayloadError(SoleEffect):
    """``dq_j = e τ_j(payload)`` in all joints: the sag under a payload whose weight is misstated.

    e is the common compliance of the joints times the relative error of the mass; only the product shows.
    """

    summary: ClassVar[str] = "the deflection in proportion to the payload differs from the model"
    phrase: ClassVar[str] = "the deflection under the payload differs from the model"
    measurement: ClassVar[str] = "measure under three payloads, one of them zero"
    inspection: ClassVar[str] = (
        "mass and centre of mass of the payload: weigh it, and compare with what the controller has"
    )
    rivals: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("joint_compliance", "link_bending", "base_compliance"),
        "measure under three weighed payloads, one of them zero: the weight of the links acts without a payload too",
    )
    sole: ClassVar[str] = "payload"
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("sag", "angle per torque"),)
    needs: ClassVar[frozenset[Input]] = frozenset({"payload"})

    kind: Literal["payload_error"] = "payload_error"

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """The torque of the payload [N m] on every joint that turns, for the parameter ``sag`` [rad/(N m)]."""
        turning = [i for i, joint in enumerate(state.robot.joints) if joint.type == "revolute"]
        return (Sensitivity({i: state.payload_torque(i) for i in turning}),)
