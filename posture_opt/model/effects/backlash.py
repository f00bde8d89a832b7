"""Backlash: a joint stops short of the side from which it arrives."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.effect import JointEffect


class Backlash(JointEffect):
    """``dq = b s / 2``, s the side from which the joint arrived."""

    summary: ClassVar[str] = "lost motion: the joint value depends on the side from which it was reached"
    parameters: ClassVar = (("width", "angle"),)
    needs: ClassVar = frozenset({"approach"})

    kind: Literal["backlash"] = "backlash"

    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        return (site.inputs.side(joint) / 2,)
