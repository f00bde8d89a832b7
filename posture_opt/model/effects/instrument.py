"""Errors of the instrument: its scale, and one that varies smoothly with the place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import ZERO, scale, subtract
from posture_opt.model.effects.base.cause import Evidence, FittedSizes, Limit, Size
from posture_opt.model.effects.base.effect import WORLD_AXES, Effect, Excitation, Sensitivity, SoleEffect, foot


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


# The six products of two coordinates that a quadratic function has
_COORDINATE_PAIRS = ("xx", "xy", "xz", "yy", "yz", "zz")


class InstrumentField(SoleEffect):
    """``dp = Σ w_ij p_i p_j``: the measured point is off by a quadratic function of where it is, seen from the base.

    What is constant or linear in the place looks like a frame or like lengths. 18 coefficients [1/m]: six a coordinate.
    What errs by more than three times the σ that is stated of the instrument is no error of it.
    """

    summary: ClassVar[str] = "the instrument errs smoothly over its volume"
    phrase: ClassVar[str] = "the instrument has an error that varies smoothly over its volume"
    measurement: ClassVar[str] = "measure the same postures from a second station of the instrument"
    inspection: ClassVar[str] = (
        "calibration and warm-up of the instrument, its line of sight, and the stability of its stand"
    )
    decisive: ClassVar[bool] = True
    sole: ClassVar[str] = "instrument"
    parameters: ClassVar[tuple[tuple[str, str], ...]] = tuple(
        (f"{axis}_{product}", "per length") for axis in "xyz" for product in _COORDINATE_PAIRS
    )
    largest_shift: ClassVar[float] = 3.0
    flexible: ClassVar[bool] = True
    for_planning: ClassVar[bool] = False

    kind: Literal["instrument_field"] = "instrument_field"

    def sensitivities(self, state: ArmState) -> tuple[Sensitivity, ...]:
        """A shift (3,) along one world axis by one product of coordinates [m²], origin at the foot of the first
        joint."""
        p = subtract(state.tool, foot(state))
        products = [p["xyz".index(pair[0])] * p["xyz".index(pair[1])] for pair in _COORDINATE_PAIRS]
        return tuple(Sensitivity(twist=(scale(one, axis), ZERO)) for axis in WORLD_AXES for one in products)

    def sizes(self, estimate: FittedSizes) -> tuple[Size, ...]:
        """How many coefficients there are: none of them alone is a size."""
        return (Size("size", f"{len(estimate.values)} coefficients, see the JSON document"),)

    def headline(self, estimate: FittedSizes) -> str:
        """None: no single number says how large it is."""
        return ""

    @classmethod
    def candidates(cls, case: Excitation) -> Sequence[Effect]:
        """The one instance, where more than one joint moves; none of touches, which no instrument sees."""
        return [cls()] if not case.contact and np.count_nonzero(np.array(case.span) > 1e-6) > 1 else []
