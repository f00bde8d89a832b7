"""A payload that weighs more or less than stated."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.model.effects.effect import Move, SoleEffect
from posture_opt.model.site import Site


class PayloadError(SoleEffect):
    """``dq_j = e τ_j(payload)`` in all joints: the sag under a payload whose weight is misstated.

    e is the common compliance of the joints times the relative error of the mass; only the product shows.
    """

    summary: ClassVar[str] = "the sag in proportion to the payload is more or less than the model's"
    sole: ClassVar = "payload"
    parameters: ClassVar = (("sag", "angle per torque"),)
    needs: ClassVar = frozenset({"payload"})

    kind: Literal["payload_error"] = "payload_error"

    def moves(self, site: Site) -> tuple[Move, ...]:
        turning = [i for i, joint in enumerate(site.robot.joints) if joint.type == "revolute"]
        return (Move({i: site.payload_torque(i) for i in turning}),)
