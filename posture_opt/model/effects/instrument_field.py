"""A smooth error of the instrument over its volume."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import ZERO, scale, subtract
from posture_opt.model.effects.base.cause import FittedSizes, Size
from posture_opt.model.effects.base.effect import WORLD_AXES, Effect, Excitation, Sensitivity, SoleEffect, foot

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
