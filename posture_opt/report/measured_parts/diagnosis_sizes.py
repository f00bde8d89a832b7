"""What report and figures derive from a diagnosis: how far its effects move the tool point, and what is noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.diagnosis.causes.plausible_causes import FittedEffects
from posture_opt.diagnosis.scores import levels
from posture_opt.model.effects.base.cause import FittedSizes
from posture_opt.numerics import rms_length
from posture_opt.report.measured_parts.error_table import mm
from posture_opt.report.text.words import MODEL_NAMES

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis

MODELS = {name: MODEL_NAMES[name] for name in ("nominal", "calibrated", "extended")}


def fitted_effects(found: Diagnosis) -> tuple[tuple[int, Finding], ...]:
    """(place among the effects of the model, finding) of every named effect."""
    return tuple((f.place, f) for f in found.effects if f.place is not None)


def fitted_sizes(found: Diagnosis, finding: Finding) -> FittedSizes:
    """What the fit says of a finding: estimate, covariance of its parameters, and the range of the turn that it
    causes.
    """
    return FittedEffects(found.model, found.linearised.sensitivities.state).sizes(finding)


def headline_of(found: Diagnosis, finding: Finding) -> str:
    """The size of a finding that is shown with its words; empty where no single number says it, or no data."""
    return "" if not finding.determined else finding.cause.headline(fitted_sizes(found, finding))


def periodic_joints(found: Diagnosis) -> list[int]:
    """Joints of which a line of the periodogram is named, largest contribution first."""
    names = list(found.model.residuals.data.joint_names)
    effects = [f.effect for f in found.effects if f.effect is not None and f.effect.spectral_lines]
    return [names.index(joint) for joint in dict.fromkeys(effect.moved_joint for effect in effects)]


@dataclass(frozen=True)
class NoiseFloor:
    """RMS [m] of the length of an error that no model can explain, 0 where it is not known.

    Args:
        rms: [m] of the length of the position error, all measured axes together.
        repeated: whether repeats of postures show it; else it is that of the instrument as stated, and how far the
            arm itself scatters is not known.
    """

    rms: float
    repeated: bool

    @property
    def label(self) -> str:
        """Its name in tables and figures."""
        return "measurement noise" if self.repeated else "instrument as stated"

    @property
    def clause(self) -> str:
        """What it accounts for, behind other errors."""
        what = "measurement noise alone" if self.repeated else "the instrument as stated"
        return f"{what} accounts for {mm(self.rms)} mm"

    @property
    def sentence(self) -> str:
        """Where it is known from, without the full stop."""
        if self.repeated:
            return "Measurement noise is the scatter of repeated postures"
        return "No posture was repeated often enough to tell the scatter; the instrument is as stated"


def noise_floor(found: Diagnosis) -> NoiseFloor:
    """The noise floor of a diagnosis: from contrasts between repeats of one posture and target, else from the
    instrument.

    ``sqrt(mean |d|²)`` of the contrasts d, each scaled to the variance of one reading; σ √k for k measured axes.
    """
    residuals, contrasts = found.model.residuals, found.contrasts
    e = found.model.whitened.reshape(-1, residuals.block)[:, : len(residuals.axes)] * residuals.sigma
    if len(contrasts) * e.shape[1] >= levels.MIN_REPEAT_FREEDOM:
        differences = contrasts.differences(e) / np.sqrt(contrasts.reading)[:, None]
        return NoiseFloor(rms_length(differences), True)
    return NoiseFloor(position_sigma(found.problem, residuals.data) * float(np.sqrt(e.shape[1])), False)
