"""A payload that weighs more or less than stated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from posture_opt.model.effects.effect import Case, Effect, Move
from posture_opt.model.site import Site


class PayloadError(Effect):
    """``dq_j = e τ_j(payload)`` in all joints: the sag under a payload whose weight is misstated.

    e is the common compliance of the joints times the relative error of the mass; only the product shows.
    """

    summary: ClassVar[str] = "the sag in proportion to the payload is more or less than the model's"
    parameters: ClassVar = (("sag", "angle per torque"),)
    needs: ClassVar = frozenset({"payload"})

    kind: Literal["payload_error"] = "payload_error"
    payload: Literal["payload"] = "payload"

    @property
    def target(self) -> str:
        return "payload"

    def moves(self, site: Site) -> tuple[Move, ...]:
        turning = [i for i, joint in enumerate(site.robot.joints) if joint.type == "revolute"]
        return (Move({i: site.payload_torque(i) for i in turning}),)

    @classmethod
    def candidates(cls, case: Case) -> Sequence[Effect]:
        return [cls()] if cls.needs <= case.inputs else []
