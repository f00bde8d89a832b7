"""What report and figures work out of a diagnosis: how far its effects move the tool point, and what is noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.model.effects.cause import FittedSizes
from posture_opt.numerics import Array
from posture_opt.report.words import MODEL_NAMES

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis

MODELS = {name: MODEL_NAMES[name] for name in ("nominal", "calibrated", "extended")}
_REPEATS = 12  # degrees of freedom of repeats, from which on they tell the noise


def fitted_effects(found: Diagnosis) -> tuple[tuple[int, Finding], ...]:
    """(place among the effects of the model, finding) of every named effect."""
    return tuple(enumerate(f for f in found.effects if f.effect is not None))


def place_of(found: Diagnosis, finding: Finding) -> int | None:
    """Where in the model an effect stands."""
    return next((place for place, f in fitted_effects(found) if f is finding), None)


def moved_at_tool(found: Diagnosis, place: int) -> Array:
    """(N,) how far an effect moves the tool point in each row [m]."""
    model, residuals = found.model, found.model.residuals
    rows = (model.effect_columns(place) @ model.x[model.slices[place]]).reshape(-1, residuals.block)
    return np.asarray(np.linalg.norm(rows[:, : len(residuals.axes)], axis=1) * residuals.sigma)


def fitted_sizes(found: Diagnosis, finding: Finding) -> FittedSizes:
    """What the fit says of a finding."""
    model, place = found.model, place_of(found, finding)
    timed = model.residuals.data.time is not None
    if place is None:
        return FittedSizes(finding.estimate, timed=timed)
    part = model.slices[place]
    return FittedSizes(finding.estimate, model.covariance[part, part], timed, _turn(found, place))


def headline_of(found: Diagnosis, finding: Finding) -> str:
    """The size of a finding that stands beside its words; empty where no single number says it."""
    return finding.cause.headline(fitted_sizes(found, finding))


def _turn(found: Diagnosis, place: int) -> tuple[float, float]:
    """Least and largest turn of its joint by an effect, 0 of one that acts on no joint [rad]."""
    model = found.model
    turned = np.zeros(len(model.residuals.data))
    ones = model.effects[place].sensitivities(found.linearised.sensitivities.state)
    for one, value in zip(ones, model.x[model.slices[place]], strict=True):
        for size in one.joints.values():
            turned = turned + value * np.asarray(size, dtype=float)
    return float(turned.min()), float(turned.max())


def periodic_joints(found: Diagnosis) -> list[int]:
    """Joints of which a line of the periodogram is named, the weightiest first."""
    names = list(found.model.residuals.data.joint_names)
    effects = [f.effect for f in found.effects if f.effect is not None and f.effect.spectral_line is not None]
    return [names.index(joint) for joint in dict.fromkeys(effect.moved_joint for effect in effects)]


def noise_floor(found: Diagnosis) -> tuple[float, str]:
    """RMS [m] of the length of an error that is noise alone, and where it is known from; 0 where it is not."""
    residuals = found.model.residuals
    e = found.model.whitened.reshape(-1, residuals.block)[:, : len(residuals.axes)] * residuals.sigma
    code, count = np.unique(residuals.data.pose, return_inverse=True, return_counts=True)[1:]
    freedom = len(code) - len(count)
    if freedom * e.shape[1] >= _REPEATS:
        means = np.stack([np.bincount(code, column) / count for column in e.T], axis=1)
        return float(np.sqrt(np.sum((e - means[code]) ** 2) / freedom)), "the scatter of repeated postures"
    measurement = residuals.sigma if not any("no σ of the instrument" in n for n in found.notes) else 0.0
    return float(measurement * np.sqrt(e.shape[1])), "the instrument as stated"
