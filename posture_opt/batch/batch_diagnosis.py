"""Diagnosis of several robots of one type: what varies from robot to robot together, and which joint is noisy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.batch.batch_calibration import Batch, calibrate_batch
from posture_opt.batch.batch_covariance import CorrelatedPair
from posture_opt.calibration.error_statistics import By
from posture_opt.calibration.parameters import CalibrationProblem
from posture_opt.diagnosis.causes import Finding, noise_finding
from posture_opt.diagnosis.diagnosis import Outcome
from posture_opt.diagnosis.linearised_data import linearise
from posture_opt.diagnosis.noise_candidates import standardised
from posture_opt.diagnosis.noise_causes import NoiseCause, find_uneven_noise, in_stated_units
from posture_opt.measurements.measurements import Measurements, repeat_of_row
from posture_opt.model.effects import CorrelatedLengths, Rows
from posture_opt.numerics import Progress
from posture_opt.result import Result


@dataclass(frozen=True, eq=False, repr=False)
class BatchDiagnosis(Result):
    """The causes that a batch shows and no single robot can: correlated lengths; and the noise that all share."""

    batch: Batch
    effects: tuple[Finding, ...]
    by: By

    @property
    def verdict(self) -> Outcome:
        """``effects_found`` or ``none_found``."""
        return "effects_found" if self.effects else "none_found"

    def to_json(self) -> dict[str, Any]:
        """The document ``diagnosis.json`` of a batch."""
        rms = {"nominal": self.batch.nominal.rms, "calibrated": self.batch.calibrated.rms}
        shares = {name: share for name, (share, _) in self.batch.coverage.items()}
        calibrated = shares.get("calibrated")
        return {
            "verdict": self.verdict,
            "effects": [finding.to_json() for finding in self.effects],
            "unexplained": {"p_value": 1.0, "place": []},
            "residual_rms": {**rms, "extended": self.batch.calibrated.rms},
            "coverage95": {**shares, "extended": calibrated},
            "cross_validation": self.by,
            "candidates": [
                {"kind": found.kind, "target": found.target, "p_value": found.p_value, "gain": 0.0}
                for found in map(_correlated, self.batch.pairs)
            ],
            "notes": list(self.batch.notes),
            "batch": self.batch.to_json()["batch"],
        }


def diagnose_batch(
    problem: CalibrationProblem,
    data: Measurements,
    *,
    folds: int = 5,
    by: By | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> BatchDiagnosis:
    """What measurements of several robots of one type say that those of one cannot.

    Every robot is calibrated by itself. Lengths that are long or short together in one robot after the other are
    named ``correlated_lengths``; noise is judged over the residuals of all robots.

    Raises:
        InputError, InsufficientDataError: as `calibrate_batch`.
    """
    batch = calibrate_batch(problem, data, folds=folds, by=by, progress=progress)
    units = {p.name: p.unit for p in batch.parameters}
    lengths = [
        _correlated(pair)
        for pair in batch.pairs
        if pair.significant and units[pair.a] == units[pair.b] == "m" and not _as_stated(pair.stated, pair.interval)
    ]
    noise = [noise_finding(cause) for cause in _noise(problem, batch, seed)]
    return BatchDiagnosis(batch, (*lengths, *noise), batch.calibrations[0].by)


def _correlated(pair: CorrelatedPair) -> Finding:
    effect = CorrelatedLengths(lengths=(pair.a, pair.b), rho=pair.correlation)
    size = {"correlation": (pair.correlation, (pair.interval[1] - pair.interval[0]) / 3.92, "1")}
    return Finding(effect, size, pair.p_value, 0.0)


def _as_stated(stated: float, interval: tuple[float, float]) -> bool:
    return stated != 0 and interval[0] <= stated <= interval[1]


def _noise(problem: CalibrationProblem, batch: Batch, seed: int) -> list[NoiseCause]:
    """Uneven noise in the residuals of all robots."""
    parts = []
    for calibration in batch.calibrations:
        linearised = linearise(calibration, 0, seed)
        baseline, residuals = linearised.baseline(), linearised.sensitivities.residuals
        m, block = residuals.measured, residuals.block
        Q = baseline.Q[:m].reshape(-1, block, baseline.Q.shape[1])
        e = standardised(baseline.e[:m].reshape(-1, block), Q @ np.swapaxes(Q, 1, 2))
        position = linearised.sensitivities.residuals.data.position
        ranges = np.zeros(len(e)) if position is None else np.linalg.norm(position, axis=1)
        e, columns, _ = in_stated_units(problem, linearised.sensitivities.residuals, e, linearised.sensitivities.joints)
        parts.append((e, columns, ranges, repeat_of_row(linearised.sensitivities.residuals.data)))
    e = np.concatenate([p[0] for p in parts])
    columns = np.concatenate([p[1] for p in parts], axis=1)
    sigma = batch.calibrations[0].residuals.sigma
    first = np.cumsum([0, *(len(p[3]) for p in parts[:-1])])
    repeats = np.concatenate([start + p[3] for start, p in zip(first, parts, strict=True)])
    return find_uneven_noise(
        e, Rows(problem.robot, columns, np.concatenate([p[2] for p in parts]), sigma, repeats), seed
    )
