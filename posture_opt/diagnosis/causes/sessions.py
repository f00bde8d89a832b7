"""Another session predicted by the arm that is delivered: whether a gain holds there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.error_statistics import Statistics, resampled_groups
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.second_file import OtherFile, errors_on, predict_other_file
from posture_opt.diagnosis.causes.delivered_effects import Delivery
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Codes, Json
from posture_opt.robot.robot import Robot

_BOOTSTRAP_DRAWS = 500


@dataclass(frozen=True)
class Gain:
    """Relative drop of an RMS with its 95 % bootstrap interval over groups of rows."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, errors: Array, without: Array, groups: Codes) -> Gain:
        """Of errors (N, d) against those ``without`` (N, d) of the same rows, which are correlated within ``groups``.

        ``1 − RMS / RMS_without``; positive where the errors became smaller. The bootstrap draws whole groups (Efron
        1979).
        """
        code = resampled_groups(groups)
        sums = np.stack([np.bincount(code, np.sum(e**2, axis=1)) for e in (errors, without)], axis=1)
        drawn = np.random.default_rng(0).integers(len(sums), size=(_BOOTSTRAP_DRAWS, len(sums)))
        totals = sums[drawn].sum(axis=1)
        ratios = 1 - np.sqrt(totals[:, 0] / np.maximum(totals[:, 1], 1e-300))
        low, high = np.quantile(ratios, [0.025, 0.975])
        total = sums.sum(axis=0)
        return cls(float(1 - np.sqrt(total[0] / max(total[1], 1e-300))), float(low), float(high))

    def to_json(self) -> dict[str, Json]:
        """Plain numbers."""
        return {"value": self.value, "interval95": [self.low, self.high]}


@dataclass(frozen=True, eq=False)
class SecondSession:
    """Another file predicted by the arm that is delivered: whether a gain holds there.

    Args:
        file: the errors of the arm before calibration, ``calibrated``, and delivered, here ``extended``.
        gain: of the effects over the calibrated arm.
        gains: of each effect of the model over the arm fitted without it; None for one that is not delivered.
        effects: of the model; ``worse`` the places of those that make rows outside the measured joint ranges worse.
        unstated: what the file does not say of itself though an effect depends on it, in sentences.
    """

    file: OtherFile
    gain: Gain
    gains: tuple[Gain | None, ...]
    effects: tuple[Effect, ...]
    worse: tuple[int, ...] = ()
    unstated: tuple[str, ...] = ()

    @property
    def models(self) -> Mapping[str, Statistics]:
        """Position errors by model."""
        return self.file.models

    @property
    def notes(self) -> tuple[str, ...]:
        """What has to be said of these figures."""
        return ("base and tool are fitted again to the test file",) * self.file.refitted + self.unstated

    def to_json(self) -> dict[str, Json]:
        """The part ``test`` of ``diagnosis.json`` [m]."""
        worse = [{"kind": self.effects[i].kind, "target": self.effects[i].target} for i in self.worse]
        return {**self.file.to_json(), "gain": self.gain.to_json(), "extrapolates_badly": worse}


def second_session(
    other: Measurements, calibration: Calibration, model: Fit, delivery: Delivery, *, refit_frames: bool = False
) -> SecondSession:
    """Errors of three models on other measurements, nothing fitted to them, or base and tool alone.

    Effects of time say nothing of another session: the arm with effects is the one that is delivered without them.

    Args:
        model: all effects of the first session; ``delivery`` those that outlast it.
        refit_frames: fit base and tool to the other file first, as where the arm was moved.

    Raises:
        InputError: unknown targets, several robots, or too few poses to fit base and tool again.
    """
    calibrated, extended = calibration.fit, delivery.fit
    fits = {"nominal": (calibrated.residuals, calibration.x_nominal)}
    fits |= {name: (fit.residuals, fit.x) for name, fit in (("calibrated", calibrated), ("extended", extended))}
    learned = calibration.request.data.take(calibration.kept_rows)
    file = predict_other_file(fits, learned, other, refit_frames)
    own, out, poses = file.errors["extended"], file.outside, file.data.pose
    gains: list[Gain | None] = [None] * len(model.effects)
    worse: list[int] = []
    rows = calibration.residuals.take(calibration.kept_rows)
    for place, i in enumerate(delivery.kept):
        fit = calibration.fit_effects(rows, [effect for k, effect in enumerate(extended.effects) if k != place])
        without = errors_on((fit.residuals, fit.x), file.data, refit_frames)
        gains[i] = Gain.of(own, without, poses)
        if out.any() and Gain.of(own[out], without[out], poses[out]).high < 0:
            worse.append(i)
    gain = Gain.of(own, file.errors["calibrated"], poses)
    unstated = _without_stated(learned, other, extended.effects, calibrated.residuals.robot)
    return SecondSession(file, gain, tuple(gains), model.effects, tuple(worse), unstated)


def _without_stated(
    mine: Measurements, other: Measurements, effects: Sequence[Effect], robot: Robot
) -> tuple[str, ...]:
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
