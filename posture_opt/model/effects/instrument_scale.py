"""An instrument whose metre is not a metre."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import ZERO
from posture_opt.model.effects.base.cause import Evidence, Limit
from posture_opt.model.effects.base.effect import Effect, Excitation, Sensitivity, SoleEffect


class InstrumentScale(SoleEffect):
    """``p → (1 + c) p``: every measured place is too far from the instrument, at the world's origin, by one share.

    An arm whose lengths are all wrong by that share does the same, so that it is no candidate of any diagnosis.
    """

    summary: ClassVar[str] = "the instrument reads all distances too long by one factor; only a scale bar shows it"
    phrase: ClassVar[str] = "the instrument has a scale error"
    measurement: ClassVar[str] = "measure a scale bar of known length with the same instrument"
    inspection: ClassVar[str] = "certificate of the instrument; the air temperature and pressure that are set in it"
    sole: ClassVar[str] = "instrument"
    parameters: ClassVar[tuple[tuple[str, str], ...]] = (("scale", "length per length"),)
    for_planning: ClassVar[bool] = False

    kind: Literal["instrument_scale"] = "instrument_scale"

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """A shift (3,) by the tool point itself [m]: distances grow from the world's origin."""
        return (Sensitivity(twist=(state.tool, ZERO)),)

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        """None: no measurement of the arm alone can show it."""
        return []

    @classmethod
    def unknowable(cls, evidence: Evidence) -> Limit | None:
        """Why positions can never show it; None of touched points, which no instrument measured."""
        if not evidence.positions:
            return None
        return Limit(
            cls.kind_name(),
            cls.sole,
            "an instrument that reads all distances too long by the same share looks exactly like an arm whose "
            "lengths are all too long by that share",
            cls.measurement,
        )
