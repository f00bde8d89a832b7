"""Another session predicted by the arm that is delivered: whether a gain holds there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.error_statistics import Statistics, resampled_groups
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.calibration.second_file import OtherFile, errors_on, predict_other_file
from posture_opt.diagnosis.causes.delivered_arm import Delivery
from posture_opt.encoding import Encoded, encoded
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Codes


@dataclass(frozen=True)
class Gain(Encoded):
    """Relative drop of an RMS with its 95 % bootstrap interval over groups of rows."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, errors: Array, without: Array, groups: Codes) -> Gain:
        """``1 − RMS / RMS_without`` of errors (N, d) against those ``without``, rows correlated within ``groups``.

        The bootstrap draws whole groups (Efron 1979).
        """
        code = resampled_groups(groups)
        sums = np.stack([np.bincount(code, np.sum(e**2, axis=1)) for e in (errors, without)], axis=1)
        drawn = np.random.default_rng(0).integers(len(sums), size=(500, len(sums)))
        totals = sums[drawn].sum(axis=1)
        ratios = 1 - np.sqrt(totals[:, 0] / np.maximum(totals[:, 1], 1e-300))
        low, high = np.quantile(ratios, [0.025, 0.975])
        total = sums.sum(axis=0)
        return cls(float(1 - np.sqrt(total[0] / max(total[1], 1e-300))), float(low), float(high))

    def fields_json(self) -> dict[str, object]:
        return {"value": self.value, "interval95": [self.low, self.high]}


@dataclass(frozen=True, eq=False)
class SecondSession(Encoded):
    """Another file predicted by the arm that is delivered: whether a gain holds there."""

    file: OtherFile
    gain: Gain
    gains: tuple[Gain | None, ...]
    effects: tuple[Effect, ...]
    worse: tuple[int, ...] = ()
    unstated: tuple[str, ...] = ()

    @property
    def models(self) -> Mapping[str, Statistics]:
        return self.file.models

    @property
    def notes(self) -> tuple[str, ...]:
        return ("base and tool are fitted again to the test file",) * self.file.refitted + self.unstated

    def fields_json(self) -> dict[str, object]:
        """The part ``test`` of ``diagnosis.json`` [m]."""
        worse = [encoded(self.effects[i], "kind target") for i in self.worse]
        return {**encoded(self, "*file gain"), "extrapolates_badly": worse}


def three_models(calibration: Calibration, extended: Fit) -> dict[str, tuple[Residuals, Array]]:
    """Residuals and parameters before calibration, calibrated, and of an arm with effects."""
    fit = calibration.fit
    return {
        "nominal": (fit.residuals, calibration.x_nominal),
        "calibrated": (fit.residuals, fit.x),
        "extended": (extended.residuals, extended.x),
    }


def second_session(
    other: Measurements, calibration: Calibration, model: Fit, delivery: Delivery, *, refit_frames: bool = False
) -> SecondSession:
    """Errors of three models on other measurements, nothing fitted to them, or base and tool alone."""
    calibrated, extended = calibration.fit, delivery.fit
    learned = calibration.request.data.take(calibration.kept_rows)
    file = predict_other_file(three_models(calibration, extended), learned, other, refit_frames)
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
    asked = {need for e in extended.effects for need in (*e.asks, *e.needs)}
    lacking = "the test file has no column {}, on which an effect depends: {} taken"
    unstated = []
    if "temperature" in asked and other.temperature is None:
        unstated.append(lacking.format("temperature [degC]", f"{REFERENCE_TEMPERATURE:g} degC is"))
    if asked & {"payload", "masses"} and learned.payload is not None and other.payload is None:
        load = f"the {calibrated.residuals.robot.payload:g} kg of the problem file are"
        unstated.append(lacking.format("payload [kg]", load))
    return SecondSession(file, gain, tuple(gains), model.effects, tuple(worse), tuple(unstated))
