"""Lost motion that grows with the load of the joint."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.effect import JointEffect
from posture_opt.model.scalars import magnitude


class LoadBacklash(JointEffect):
    """``dq = h s |τ|``, s the side from which the joint arrived and τ the torque of gravity."""

    summary: ClassVar[str] = "lost motion in proportion to the load of the joint, as friction leaves it"
    parameters: ClassVar = (("height", "angle per torque"),)
    needs: ClassVar = frozenset({"approach", "masses"})

    kind: Literal["load_backlash"] = "load_backlash"

    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        return (site.inputs.side(joint) * magnitude(site.torque(joint)),)
