"""Calibration: the parameters of the arm from measurements, with honest errors, and what they bring."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.comparison import compare, fit_frames, fit_groups, held_length
from posture_opt.diagnosis.estimation import Estimate, Prior, estimate
from posture_opt.diagnosis.identifiability import Identifiability, identify
from posture_opt.diagnosis.measurements import Measurements
from posture_opt.diagnosis.parameters import CalibrationProblem, Parameter, prior_covariance
from posture_opt.diagnosis.residuals import Residuals
from posture_opt.diagnosis.validation import By, Statistics, folds_of, groups_of
from posture_opt.errors import InputError, InsufficientDataError, Issue

Array = NDArray[np.float64]

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
    notes: tuple[str, ...] = ()

    @property
    def std(self) -> Array:
        """(k,) standard errors [rad, m]; NaN where nothing determines the parameter."""
        return np.where(self.fixed, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)), np.nan)

    def to_json(self) -> dict[str, Any]:
        """The document ``calibration.json``: SI units and radians."""
        rows = zip(self.parameters, self.x, self.std, self.fixed, strict=True)
        document: dict[str, Any] = {
            "residual_rms": {"nominal": self.nominal.rms, "calibrated": self.calibrated.rms},
            "residuals": {"nominal": self.nominal.to_json(), "calibrated": self.calibrated.to_json()},
            "coverage95": dict(self.coverage),
            "cross_validation": self.by,
            "parameters": [
                {
                    "name": p.name,
                    "estimate": float(p.nominal + x),
                    "std": float(s) if known else None,
                    "nominal": p.nominal,
                    "unit": p.unit,
                    "determined": bool(known),
                }
                for p, x, s, known in rows
            ],
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


def calibrate(
    problem: CalibrationProblem,
    data: Measurements,
    *,
    priors: bool = True,
    folds: int = 5,
    by: By | None = None,
    test: Measurements | None = None,
    refit_frames: bool = False,
) -> Calibration:
    """Estimate the parameters that the data determine, and what that brings where nothing was seen.

    Free frames and touched points start from a closed form; then everything is fitted together, in the directions
    that the data determine at the nominal model. Errors are cross-validated: every row is predicted by an arm
    that has not seen its group (``by``: its pose, its block of the workspace, or the place that it touched).

    Args:
        priors: whether stated σ's of parameters count as knowledge.
        test: other measurements, predicted with nothing refitted, or with base and tool if ``refit_frames``.

    Raises:
        InputError: several robots at once, or a test file with other targets.
        InsufficientDataError: fewer measurements than unknowns.
    """
    residuals, notes = compare(problem, data)
    groups_by: By = by or ("place" if data.position is None else "pose")
    groups = groups_of(data, groups_by, folds)
    x_nominal = fit_frames(problem.robot, residuals)
    r, J = residuals.both(x_nominal)
    names = [p.name for p in residuals.parameters]
    held = held_length(residuals)
    identifiability = identify(names, J, len(data), held)
    if held is not None:
        notes = (*notes, SIZE.format(names[held]))
    _check_amount(len(r), identifiability, len(np.unique(data.pose)), len(np.unique(groups)))
    prior, directions, fixed = _with_priors(problem, residuals, identifiability, J, held, priors)
    found = estimate(residuals, x_nominal, directions, prior)
    rows = _Rows(groups, groups_by, folds, found.kept)
    nominal_errors, _ = _validated(problem, residuals, rows, None, prior)
    errors, inside = _validated(problem, residuals, rows, directions, prior, found.fit.x)
    gone = np.flatnonzero(~found.kept)
    notes += ("base and tool are fitted again to the test file",) * (test is not None and refit_frames)
    return Calibration(
        parameters=residuals.parameters,
        x_nominal=x_nominal,
        x=found.x,
        covariance=found.covariance,
        fixed=fixed,
        identifiability=identifiability,
        nominal=Statistics.of(nominal_errors[found.kept], groups[found.kept]),
        calibrated=Statistics.of(errors[found.kept], groups[found.kept]),
        errors_nominal=nominal_errors,
        errors=errors,
        errors_fitted=_errors(residuals, found.x),
        residuals=residuals,
        coverage={"calibrated": float(inside[found.kept].mean())},
        outliers=tuple(int(i) for i in gone),
        lines=tuple(int(line) for line in data.line[gone]),
        variance=found.variance,
        by=groups_by,
        test=_tested(residuals, test, x_nominal, found, refit_frames),
        notes=notes,
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    """Which rows a cross-validation leaves out together, and which it never learns from."""

    groups: NDArray[np.intp]
    by: By
    folds: int
    kept: NDArray[np.bool_]


def _check_amount(count: int, identifiability: Identifiability, poses: int, groups: int) -> None:
    if count <= identifiability.rank or groups < 2:
        need = identifiability.rank
        raise InsufficientDataError(
            f"{count} measured coordinates in {poses} pose{'s' * (poses != 1)} cannot determine {need} parameters "
            f"and their errors: measure at least {int(np.ceil(need / 3)) + 5} poses spread over the workspace"
        )


def _with_priors(
    problem: CalibrationProblem,
    residuals: Residuals,
    identifiability: Identifiability,
    J: Array,
    held: int | None,
    wanted: bool,
) -> tuple[Prior | None, Array, NDArray[np.bool_]]:
    rows, covariance = prior_covariance(problem, residuals.parameters) if wanted else ([], np.zeros((0, 0)))
    if not rows:
        return None, identifiability.directions, identifiability.determined
    prior = Prior.of(rows, covariance)
    stacked = np.concatenate([J, prior.matrix(J.shape[1])])
    both = identify(identifiability.names, stacked, len(residuals.data), held)
    return prior, both.directions, both.determined


def _validated(
    problem: CalibrationProblem,
    residuals: Residuals,
    rows: _Rows,
    directions: Array | None,
    prior: Prior | None,
    near: Array | None = None,
) -> tuple[Array, NDArray[np.bool_]]:
    """Errors (N, 3) [m] of every row by a model that has not seen its group, and whether they were to be expected."""
    from scipy.special import gammaincinv

    data = residuals.data
    errors, inside = np.zeros((len(data), 3)), np.zeros(len(data), dtype=bool)
    for left_out in folds_of(rows.groups, rows.folds, rows.by):
        learn = rows.kept.copy()
        learn[left_out] = False
        training = residuals.take(np.flatnonzero(learn))
        x = fit_frames(problem.robot, training)
        if directions is not None:
            x = estimate(training, x, directions, prior, robust=False, near=near).x
        errors[left_out] = _errors(residuals.take(left_out), x)
        taught = _errors(training, x)[:, residuals.axes]
        C = taught.T @ taught / max(len(taught) - len(residuals.parameters) / 3, 1)
        e = errors[np.ix_(left_out, residuals.axes)]
        squared = np.einsum("ni,ni->n", e, np.linalg.solve(C, e.T).T)
        inside[left_out] = squared <= 2 * gammaincinv(C.shape[0] / 2, 0.95)
    return errors, inside


def _errors(residuals: Residuals, x: Array) -> Array:
    """Position errors (N, 3) [m]; of touched points, about the mean of each point, which no one knows otherwise."""
    error = residuals.error(x)
    if residuals.data.position is None:
        for code in np.unique(residuals.data.point):
            mine = residuals.data.point == code
            error[mine] -= error[mine].mean(axis=0)
    else:
        error[:, ~residuals.data.measured_axes] = 0.0
    return error


def _tested(
    residuals: Residuals, test: Measurements | None, x_nominal: Array, found: Estimate, refit: bool
) -> dict[str, Statistics]:
    if test is None:
        return {}
    if test.target_names != residuals.data.target_names or (test.position is None) != (residuals.data.position is None):
        raise InputError(Issue("the test file measures other targets", mend="test with the same points on the tool"))
    other = replace(residuals, data=test, distances=())
    result = {}
    for name, x in (("nominal", x_nominal), ("calibrated", found.x)):
        again = fit_groups(other, x, {"base", "tool"}) if refit else None
        result[name] = Statistics.of(_errors(other, x if again is None else again.x), test.pose)
    return result
