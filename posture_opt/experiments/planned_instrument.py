"""The rule by which postures are planned for an instrument."""

from __future__ import annotations

from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.experiments.planned_kind import KindPlaces
from posture_opt.experiments.planned_mixed import MixedPlaces
from posture_opt.experiments.planned_pairs import PairPlaces
from posture_opt.experiments.planned_pictures import BoardPosePlaces, PicturePlaces
from posture_opt.measurements.kinds import BoardPose, MarkerPixels, Mixed, PairContact
from posture_opt.numerics import Array

_RULES: dict[type, type[KindPlaces]] = {
    MarkerPixels: PicturePlaces, BoardPose: BoardPosePlaces, PairContact: PairPlaces,
}  # fmt: skip
"""Kinds that look at more than the aspect of the tool beside a place."""


def planned_places(residuals: Residuals, x: Array) -> KindPlaces:
    """The places of the given rows by a fit x (k,) to them [rad, m], by the rule of their kind."""
    if isinstance(residuals.data.kind, Mixed):
        return MixedPlaces.of_instruments(residuals, x, _by_rule)
    return _by_rule(KindPlaces.of(residuals, x))


def _by_rule(places: KindPlaces) -> KindPlaces:
    """The places of one instrument by the rule of its kind."""
    rule = _RULES.get(type(places.kind), KindPlaces)
    return rule(places.data, places.robot, places.moved, places.values)
