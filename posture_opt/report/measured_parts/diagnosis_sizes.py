"""What report and figures derive from a diagnosis: how far its effects move the tool point, and what is noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.diagnosis.scores import levels
from posture_opt.numerics import rms_length
from posture_opt.report.measured_parts.error_table import mm
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements.notation import stated_length

if TYPE_CHECKING:
    from posture_opt.diagnosis.causes.causes import Finding
    from posture_opt.diagnosis.diagnosis import Diagnosis
    from posture_opt.model.effects import NoiseEffect

_CLEARLY_MORE = 1.25  # times the instrument as stated: what repeats scatter by is worth a word then
MODELS = {name: MODEL_NAMES[name] for name in ("nominal", "calibrated", "extended")}


def fitted_effects(found: Diagnosis) -> tuple[tuple[int, Finding], ...]:
    """(place among the effects of the model, finding) of every named effect."""
    return tuple((f.place, f) for f in found.effects if f.place is not None)


def headline_of(finding: Finding) -> str:
    """The size of a finding that is shown with its words; empty where no single number says it, or no data."""
    return "" if not finding.determined else finding.cause.headline(finding.sizes)


def largest_scatter(found: Diagnosis, noise: NoiseEffect) -> float:
    """The largest standard deviation [m] of the tool point in the data by a joint that scatters: ``σ max |J_j|``."""
    residuals = found.model.residuals
    (sigma,) = noise.scatter(residuals.robot).values()
    joint = residuals.robot.joint_names.index(noise.moved_joint)
    moved = residuals.metres(found.linearised.sensitivities.joints[joint][:, : len(residuals.axes)])
    return sigma * float(np.linalg.norm(moved, axis=1).max())


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
        coordinate: σ of the instrument in one of the ``axes`` coordinates as stated [m], where that is the floor.
        source: what has that σ.
        stated: the floor by the instrument as stated, beside that of repeats [m]; 0 where it is not known.
    """

    rms: float
    repeated: bool
    coordinate: float = 0.0
    axes: int = 1
    source: Literal["instrument", "touch"] = "instrument"
    stated: float = 0.0

    @property
    def label(self) -> str:
        """Its name in tables and figures."""
        return "measurement noise" if self.repeated else f"{self.source} as stated"

    @property
    def clause(self) -> str:
        """What it accounts for, behind other errors."""
        more = self.repeated and 0 < self.stated * _CLEARLY_MORE < self.rms
        beside = f", and the {self.source} as stated for {mm(self.stated)} mm of it" if more else ""
        return f"{self.words} accounts for {mm(self.rms)} mm{beside}"

    @property
    def words(self) -> str:
        """What it is; of the instrument how the length of an error comes from σ of a coordinate."""
        if self.repeated:
            return "the scatter of repeated postures, of arm and instrument,"
        each = f" ({stated_length(self.coordinate)} in each of {self.axes} coordinates)" if self.axes > 1 else ""
        return f"the {self.source} as stated{each}"

    @property
    def sentence(self) -> str:
        """Where it is known from, without the full stop."""
        if self.repeated:
            return "Measurement noise is the scatter of repeated postures"
        return f"No posture was repeated often enough to tell the scatter; the {self.source} is as stated"


def noise_floor(found: Diagnosis) -> NoiseFloor:
    """The noise floor of a diagnosis: from contrasts between repeats of one posture and target, else from the
    instrument.

    ``sqrt(mean |d|²)`` of the contrasts d, each scaled to the variance of one reading; σ √k for k measured axes.
    """
    residuals, contrasts = found.model.residuals, found.contrasts
    e = found.model.whitened.reshape(-1, residuals.block)[:, : len(residuals.axes)] * residuals.sigma
    sigma, axes = position_sigma(found.problem, residuals.data), e.shape[1]
    source: Literal["instrument", "touch"] = "touch" if residuals.data.touches else "instrument"
    stated = sigma * float(np.sqrt(axes))
    if len(contrasts) * axes >= levels.MIN_REPEAT_FREEDOM:
        differences = contrasts.differences(e) / np.sqrt(contrasts.reading)[:, None]
        return NoiseFloor(rms_length(differences), True, source=source, stated=stated)
    return NoiseFloor(stated, False, sigma, axes, source)


def held_out_noise(found: Diagnosis, floor: NoiseFloor) -> float:
    """The noise floor with what it costs to fit many parameters to few numbers [m].

    Rows left out are predicted with the errors of a fit to the others: ``noise · sqrt(1 + k / m)`` for k parameters
    fitted to m numbers.
    """
    rounds = min(found.request.folds, len(np.unique(found.groups)))
    numbers = len(found.model.residuals.data) * len(found.model.residuals.axes)
    return floor.rms * float(np.sqrt(1 + found.model.count / (numbers * (1 - 1 / max(rounds, 2)))))


def like_noise(found: Diagnosis) -> bool:
    """Whether the residual error is about as large as noise: nothing more than that is left on average."""
    floor = noise_floor(found)
    return floor.rms > 0 and held_out_noise(found, floor) >= found.errors["extended"].interval[0]
