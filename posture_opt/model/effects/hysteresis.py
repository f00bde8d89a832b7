"""Hysteresis: lost motion that grows with the length of the last move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.model.effects.effect import Effect, Excitation, JointEffect
from posture_opt.model.scalars import exp
from posture_opt.units import Angle

_GRID = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.5)  # rad


class Hysteresis(JointEffect):
    """``dq = h s (1 − exp(−d / d0))``, s and d side and length of the last move."""

    summary: ClassVar[str] = "lost motion that grows with the travel before"
    parameters: ClassVar = (("height", "angle"),)
    shape: ClassVar = ("travel",)
    shape_units: ClassVar = {"travel": "rad"}
    needs: ClassVar = frozenset({"approach"})

    kind: Literal["hysteresis"] = "hysteresis"
    travel: Angle = Field(gt=0, description="d0, travel after which 63 % is reached")

    def features(self, site: ArmState, joint: int) -> tuple[Scalar, ...]:
        return (site.inputs.side(joint) * (1 - exp(-site.inputs.travel(joint) / self.travel)),)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        if not cls.needs <= case.inputs:
            return []
        return [cls(joint=name, travel=f"{d} rad") for name in case.moving("revolute") for d in _GRID]
