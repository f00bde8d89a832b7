"""What outlasts the session of a fitted arm, and another session predicted by it: whether a gain holds there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.cross_validation import session_errors
from posture_opt.calibration.error_statistics import Statistics
from posture_opt.calibration.fit import Fit
from posture_opt.calibration.linear_model import LinearModel
from posture_opt.diagnosis.delivery import Delivery
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot

_DRAWS = 500


@dataclass(frozen=True)
class Gain:
    """Relative drop of an RMS with its 95 % bootstrap interval over groups of rows."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, errors: Array, without: Array, groups: Codes) -> Gain:
        """Of errors (N, d) against those ``without`` (N, d) of the same rows, which hang together in ``groups``."""
        code = np.unique(groups, return_inverse=True)[1]
        sums = np.stack([np.bincount(code, np.sum(e**2, axis=1)) for e in (errors, without)], axis=1)
        drawn = np.random.default_rng(0).integers(len(sums), size=(_DRAWS, len(sums)))
        totals = sums[drawn].sum(axis=1)
        ratios = 1 - np.sqrt(totals[:, 0] / np.maximum(totals[:, 1], 1e-300))
        low, high = np.quantile(ratios, [0.025, 0.975])
        total = sums.sum(axis=0)
        return cls(float(1 - np.sqrt(total[0] / max(total[1], 1e-300))), float(low), float(high))

    def to_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return {"value": self.value, "interval95": [self.low, self.high]}


@dataclass(frozen=True, eq=False)
class SecondSession:
    """Another file predicted by what one taught.

    Args:
        data: the other file; ``errors`` by model (N, 3) model minus measured [m].
        models: position errors before calibration, calibrated, and with the effects that can be planned with.
        gain: of the effects over the calibrated arm.
        gains: (effects) of each effect over the model without it; None for one that changes with time.
        refitted: whether base and tool were fitted again.
        unstated: what the file does not say of itself though an effect depends on it, in sentences.
    """

    data: Measurements
    errors: Mapping[str, Array]
    models: Mapping[str, Statistics]
    gain: Gain
    gains: tuple[Gain | None, ...]
    refitted: bool
    unstated: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What has to be said of these figures."""
        notes = ["base and tool are fitted again to the test file"] if self.refitted else []
        if any(gain is None for gain in self.gains):
            notes.append(
                "effects of time are left out of the prediction of the test file: they belong to their session"
            )
        if any(gain is not None for gain in self.gains) and self.gain.low <= 0:
            sure = "no gain" if self.gain.value <= 0 else "no sure gain"
            notes.append(
                f"the effects bring {sure} on the test file: RMS {self.models['calibrated'].rms * 1e3:.4g} mm "
                f"calibrated, {self.models['extended'].rms * 1e3:.4g} mm with them"
            )
        return (*notes, *self.unstated)

    def to_json(self) -> dict[str, Any]:
        """The part ``test`` of ``diagnosis.json`` [m]."""
        models = {name: statistics.to_json() for name, statistics in self.models.items()}
        return {**models, "gain": self.gain.to_json(), "frames_refitted": self.refitted, "rows": len(self.data)}


def second_session(
    other: Measurements, calibration: Calibration, model: Fit, delivery: Delivery, *, refit_frames: bool = False
) -> SecondSession:
    """Errors of three models on other measurements, nothing fitted to them, or base and tool alone.

    Effects of time say nothing of another session: the arm with effects is the one that is delivered without them.

    Raises:
        InputError: other targets, several robots, or too few poses to fit base and tool again.
    """
    calibrated, kept = calibration.fit, delivery.kept
    fits = {"nominal": replace(calibrated, x=calibration.x_nominal), "calibrated": calibrated, "extended": delivery.fit}
    errors = {name: session_errors(fit.residuals, fit.x, other, refit_frames) for name, fit in fits.items()}
    gains: list[Gain | None] = [None] * len(model.effects)
    about = LinearModel.of(delivery.fit)
    for place, i in enumerate(kept):
        rest = [k for k in range(len(kept)) if k != place]
        without = replace(delivery.fit, x=delivery.fit.x + about.refitted(place)).keeping(rest)
        gains[i] = Gain.of(
            errors["extended"], session_errors(without.residuals, without.x, other, refit_frames), other.pose
        )
    sizes = {name: Statistics.of(e, other.pose) for name, e in errors.items()}
    gain = Gain.of(errors["extended"], errors["calibrated"], other.pose)
    unstated = _unstated(calibration.request.data, other, delivery.fit.effects, calibration.residuals.robot)
    return SecondSession(other, errors, sizes, gain, tuple(gains), refit_frames, unstated)


def _unstated(mine: Measurements, other: Measurements, effects: Sequence[Effect], robot: Robot) -> tuple[str, ...]:
    """What effects ask for, the first file states and the other does not, with what is taken for it."""
    asked = {need for e in effects for need in (*e.asks, *e.needs)}
    notes = []
    if "temperature" in asked and other.temperature is None:
        at = f"{REFERENCE_TEMPERATURE:g} degC"
        notes.append(f"the test file has no column temperature [degC], on which an effect depends: {at} is taken")
    if asked & {"payload", "masses"} and mine.payload is not None and other.payload is None:
        load = f"{robot.payload:g} kg of the problem file"
        notes.append(f"the test file has no column payload [kg], on which an effect depends: the {load} are taken")
    return tuple(notes)
