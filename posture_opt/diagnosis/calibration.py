"""Calibration: the parameters of the arm from measurements, with honest errors, and what they bring."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from math import erfc, isfinite, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.chart import Chart
from posture_opt.diagnosis.clusters import clustered_covariance
from posture_opt.diagnosis.comparison import compare, fit_frames, held_length
from posture_opt.diagnosis.cross_validation import position_errors, predict, tested
from posture_opt.diagnosis.estimation import Estimate, estimate
from posture_opt.diagnosis.identifiability import Identifiability
from posture_opt.diagnosis.knowledge import Knowledge, determine, unseen
from posture_opt.diagnosis.measurements import Measurements
from posture_opt.diagnosis.parameters import CalibrationProblem, Parameter
from posture_opt.diagnosis.residuals import Residuals
from posture_opt.diagnosis.sufficiency import check_amount, check_frames, check_geometry, check_sense, still_notes
from posture_opt.diagnosis.validation import By, Statistics, folds_of, groups_of

Array = NDArray[np.float64]

Progress = Callable[[int, int], None]

_ROUNDS = 3  # of fitting and judging the noise anew
CORRELATED = 0.9  # from here on, one of two estimates leans on the other
SIZE = "touched points alone do not tell the size of the arm: {} is held; state a distance under data.distances"


@dataclass(frozen=True, eq=False)
class Calibration:
    """What measurements say about the parameters of an arm.

    Args:
        parameters: the (k,) candidates; ``x_nominal`` and ``x`` are deviations from their nominal values [rad, m],
            with only free frames fitted, and with everything fitted.
        covariance: (k, k) of ``x``; directions that are not determined have no variance in it.
        fixed: (k,) whether the data, or a prior, determine the parameter.
        identifiability: rank, observability and the undetermined combinations in words.
        nominal, calibrated: position errors by cross-validation [m], nominal with free frames fitted.
        errors_nominal, errors: (N, 3) those errors row by row; ``calibrated`` leaves the outliers out.
        errors_fitted: (N, 3) position errors of the arm fitted to all rows [m].
        residuals: the arm against these measurements, as a function of ``x``.
        coverage: share of rows inside the predicted 95 % region.
        outliers: rows left out of the fit, counted from 0; ``lines`` are their lines in the file.
        variance: residual variance in units of the instrument's.
        by: the groups that the cross-validation left out together.
        test: another file predicted by what this one taught.
        prior: (k,) the stated σ of each parameter that counts as knowledge [rad, m]; NaN where there is none.
        unseen: (k,) part of the standard errors that combinations leave which nothing tells [rad, m].
        design: how many rows tell as much as one alone would, as neighbouring postures err alike.
        notes: sentences for the report.
    """

    parameters: tuple[Parameter, ...]
    x_nominal: Array
    x: Array
    covariance: Array
    fixed: NDArray[np.bool_]
    identifiability: Identifiability
    nominal: Statistics
    calibrated: Statistics
    errors_nominal: Array
    errors: Array
    errors_fitted: Array
    residuals: Residuals
    coverage: dict[str, float]
    outliers: tuple[int, ...]
    lines: tuple[int, ...]
    variance: float
    by: By
    test: dict[str, Statistics]
    prior: Array
    unseen: Array
    design: float = 1.0
    notes: tuple[str, ...] = ()

    @property
    def std(self) -> Array:
        """(k,) standard errors [rad, m]; NaN where nothing determines the parameter."""
        variance = np.maximum(np.diag(self.covariance), 0.0) + self.unseen**2
        return np.where(self.fixed, np.sqrt(variance), np.nan)

    @property
    def z(self) -> Array:
        """(k,) deviations from nominal over their standard errors; NaN where nothing determines the parameter."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(self.std > 0, self.x / self.std, np.nan))

    @property
    def p_values(self) -> Array:
        """(k,) probability of a deviation as far from nominal where the parameter has its nominal value; or NaN."""
        return np.array([erfc(abs(z) / 2**0.5) if isfinite(z) else nan for z in self.z.tolist()])

    @property
    def correlation(self) -> Array:
        """(k, k) of the estimates; zero where nothing determines the parameter."""
        variance = np.diag(self.covariance)
        scale = np.where(self.fixed & (variance > 0), 1 / np.sqrt(np.maximum(variance, 1e-300)), 0.0)
        return np.asarray(self.covariance * np.outer(scale, scale))

    def to_json(self) -> dict[str, Any]:
        """The document ``calibration.json``: SI units and radians."""
        document: dict[str, Any] = {
            "residual_rms": {"nominal": self.nominal.rms, "calibrated": self.calibrated.rms},
            "residuals": {"nominal": self.nominal.to_json(), "calibrated": self.calibrated.to_json()},
            "coverage95": dict(self.coverage),
            "cross_validation": self.by,
            "parameters": [self._parameter(i) for i in range(len(self.parameters))],
            "correlations": self._correlations(),
            "rows_per_independent": self.design,
            "rank": self.identifiability.rank,
            "condition": self.identifiability.condition,
            "singular_values": [float(s) for s in self.identifiability.singular_values],
            "observability": dict(self.identifiability.observability),
            "undetermined": list(self.identifiability.words),
            "residual_variance": self.variance,
            "outliers": list(self.outliers),
            "outlier_lines": list(self.lines),
            "notes": list(self.notes),
        }
        if self.test:
            document["test"] = {name: statistics.to_json() for name, statistics in self.test.items()}
        return document

    def _parameter(self, i: int) -> dict[str, Any]:
        p, known = self.parameters[i], bool(self.fixed[i])
        values = {"std": self.std[i], "prior": self.prior[i], "z": self.z[i], "p_value": self.p_values[i]}
        return {
            "name": p.name,
            "estimate": float(p.nominal + self.x[i]),
            "nominal": p.nominal,
            "unit": p.unit,
            "determined": known,
            **{name: float(value) if np.isfinite(value) else None for name, value in values.items()},
        }

    def _correlations(self) -> list[dict[str, Any]]:
        """Pairs of estimates that hang together closely."""
        C, names = self.correlation, [p.name for p in self.parameters]
        pairs = np.argwhere(np.triu(np.abs(C) > CORRELATED, 1))
        return [{"parameters": [names[i], names[j]], "correlation": float(C[i, j])} for i, j in pairs]


def calibrate(
    problem: CalibrationProblem,
    data: Measurements,
    *,
    priors: bool = True,
    folds: int = 5,
    by: By | None = None,
    test: Measurements | None = None,
    refit_frames: bool = False,
    progress: Progress | None = None,
) -> Calibration:
    """Estimate the parameters that the data determine, and what that brings where nothing was seen.

    Free frames and touched points start from a closed form; then everything is fitted together. Frames that are
    neither free nor given a σ are taken as stated. What the data tell less well than to 10 mm and 1° counts as not
    determined, and is held near its nominal value by these, unless ``priors`` is off: then it stays there. Errors are
    cross-validated: every row is predicted by an arm that has not seen its group (``by``: its pose, its block of the
    workspace, or the place that it touched).

    Args:
        priors: whether stated σ's of parameters count as knowledge.
        test: other measurements, predicted with nothing refitted, or with base and tool if ``refit_frames``.
        progress: is told after each fit how many of how many are done.

    Raises:
        InputError: several robots at once, or a test file with other targets.
        InsufficientDataError: fewer measurements than unknowns.
    """
    given, notes = compare(problem, data)
    chart = Chart.of(given)
    residuals = chart.fitted
    groups_by: By = by or ("place" if data.position is None else "pose")
    groups = groups_of(data, groups_by, folds)
    x_nominal = fit_frames(problem.robot, residuals)
    held = held_length(residuals)
    if held is not None:
        notes = (*notes, SIZE.format(residuals.parameters[held].name))
    check_frames(residuals, position_errors(residuals, x_nominal))
    known = determine(problem, residuals, x_nominal, held, priors)
    check_amount(residuals, known, len(np.unique(groups)))
    parts = folds_of(groups, folds, groups_by)
    tell = _teller(progress, 2 * len(parts) + 1)
    known, found = _fitted(problem, residuals, x_nominal, known, held, priors)
    check_sense(residuals, position_errors(residuals, found.x)[found.kept])
    check_geometry(residuals, known)
    tell()
    nominal = predict(residuals, parts, found, None, tell)
    calibrated = predict(residuals, parts, found, known, tell)
    covariance = found.covariance
    if known.design > 1:
        covariance = clustered_covariance(residuals, found, known.directions, known.prior)
    gone = np.flatnonzero(~found.kept)
    notes += ("base and tool are fitted again to the test file",) * (test is not None and refit_frames)
    return Calibration(
        parameters=given.parameters,
        x_nominal=chart.told(x_nominal),
        x=chart.told(found.x),
        covariance=chart.told_covariance(found.x, covariance),
        fixed=chart.told_fixed(found.x, known.fixed, covariance),
        identifiability=known.identifiability,
        nominal=Statistics.of(nominal.errors[found.kept], groups[found.kept]),
        calibrated=Statistics.of(calibrated.errors[found.kept], groups[found.kept]),
        errors_nominal=nominal.errors,
        errors=calibrated.errors,
        errors_fitted=position_errors(residuals, found.x),
        residuals=given,
        coverage={"calibrated": float(calibrated.inside[found.kept].mean())},
        outliers=tuple(int(i) for i in gone),
        lines=tuple(int(line) for line in data.line[gone]),
        variance=found.variance,
        by=groups_by,
        test=tested(residuals, test, x_nominal, found.x, refit_frames),
        prior=known.stated,
        unseen=chart.told_size(found.x, unseen(residuals, known, found, held)),
        design=known.design,
        notes=(
            *notes,
            *still_notes(problem.robot, data),
            *known.notes,
            *found.notes,
            *_restless(calibrated.restless, len(parts)),
        ),
    )


def _fitted(
    problem: CalibrationProblem, residuals: Residuals, x: Array, known: Knowledge, held: int | None, priors: bool
) -> tuple[Knowledge, Estimate]:
    """The estimate, and what is determined with the noise that it leaves.

    An arm far off its drawing bends away from its tangents, which looks like noise until it is fitted: then the same
    directions are judged again.
    """
    for _ in range(_ROUNDS):
        found = estimate(residuals, x, known.directions, known.prior, weight=1.0, design=known.design)
        again = determine(problem, residuals, x, held, priors, found)
        if again.noise > known.noise / 2:
            break
        known = again
    return known, found


def _teller(progress: Progress | None, total: int) -> Callable[[], None]:
    """Tells one more of ``total`` fits at each call."""
    done = count(1)
    return lambda: progress(next(done), total) if progress is not None else None


def _restless(fits: int, rounds: int) -> tuple[str, ...]:
    return (f"{fits} of the {rounds} fits of the cross-validation did not come to rest",) if fits else ()
