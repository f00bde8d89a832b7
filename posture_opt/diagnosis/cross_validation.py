"""Errors where nothing was seen: every group of rows predicted by an arm fitted to the others, or by another file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.comparison import fit_frames, fit_groups
from posture_opt.diagnosis.estimation import Estimate, estimate
from posture_opt.diagnosis.knowledge import Knowledge
from posture_opt.diagnosis.measurements import Measurements
from posture_opt.diagnosis.parameters import CalibrationProblem, candidates
from posture_opt.diagnosis.residuals import Residuals
from posture_opt.diagnosis.validation import Statistics
from posture_opt.errors import InputError, Issue

Array = NDArray[np.float64]
Codes = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Predicted:
    """Every row by an arm that has not seen its group.

    Args:
        errors: (N, 3) of the position [m].
        inside: (N,) whether the row lies in the 95 % region that the arm predicts.
        restless: how many fits did not come to rest.
    """

    errors: Array
    inside: NDArray[np.bool_]
    restless: int


def predict(
    residuals: Residuals, folds: list[Codes], found: Estimate, known: Knowledge | None, tell: Callable[[], None]
) -> Predicted:
    """Every row by an arm that was fitted to the other folds: all that is known to be fitted, or free frames alone.

    Args:
        found: the estimate from all rows: its outliers teach nothing, and the fits start near it.
        tell: is called after each fit.
    """
    from scipy.special import gammaincinv

    data = residuals.data
    errors, inside, restless = np.zeros((len(data), 3)), np.zeros(len(data), dtype=bool), 0
    for left_out in folds:
        learn = found.kept.copy()
        learn[left_out] = False
        training = residuals.take(np.flatnonzero(learn))
        x = fit_frames(residuals.robot, training)
        if known is not None:
            again = estimate(
                training, x, known.directions, known.prior, robust=False, near=found.fit.x,
                weight=float(np.sqrt(known.design * found.variance)), design=known.design,
            )  # fmt: skip
            x, restless = again.x, restless + (not again.at_rest)
        errors[left_out] = position_errors(residuals.take(left_out), x)
        taught = position_errors(training, x)[:, residuals.axes]
        C = taught.T @ taught / max(len(taught) - len(residuals.parameters) / 3, 1)
        e = errors[np.ix_(left_out, residuals.axes)]
        # An arm in a plane has no error across it: C then spans the plane only.
        squared = np.einsum("ni,ni->n", e @ np.linalg.pinv(C, rcond=1e-12, hermitian=True), e)
        inside[left_out] = squared <= 2 * gammaincinv(max(np.linalg.matrix_rank(C, hermitian=True), 1) / 2, 0.95)
        tell()
    return Predicted(errors, inside, restless)


def position_errors(residuals: Residuals, x: Array) -> Array:
    """Position errors (N, 3) [m]; of touched points, about the mean of each point, which no one knows otherwise."""
    error = residuals.error(x)
    if residuals.data.position is None:
        for code in np.unique(residuals.data.point):
            mine = residuals.data.point == code
            error[mine] -= error[mine].mean(axis=0)
    else:
        error[:, ~residuals.data.measured_axes] = 0.0
    return error


def tested(
    problem: CalibrationProblem, residuals: Residuals, test: Measurements | None, x_nominal: Array, x: Array,
    refit: bool,
) -> dict[str, Statistics]:  # fmt: skip
    """The position errors of another file, predicted by ``x``, and by the arm as it stands.

    Raises:
        InputError: the file measures other targets.
    """
    if test is None:
        return {}
    if test.target_names != residuals.data.target_names or (test.position is None) != (residuals.data.position is None):
        raise InputError(Issue("the test file measures other targets", mend="test with the same points on the tool"))
    other = replace(residuals, data=test, distances=())
    if refit:
        return _refitted(problem, other, {"nominal": x_nominal, "calibrated": x})
    return {
        name: Statistics.of(position_errors(other, at), test.pose)
        for name, at in (("nominal", x_nominal), ("calibrated", x))
    }


def _refitted(problem: CalibrationProblem, other: Residuals, models: dict[str, Array]) -> dict[str, Statistics]:
    """The same with base and tool fitted again, though the problem file may state them as known."""
    robot = replace(problem.robot, base_free=True, tool_free=True)
    wide = replace(other, parameters=candidates(robot, other.data, orientation=other.oriented))
    found = {}
    for name, x in models.items():
        value = dict(zip((p.name for p in other.parameters), x, strict=True))
        start = np.array([value.get(p.name, 0.0) for p in wide.parameters])
        again = fit_groups(wide, start, {"base", "tool"})
        found[name] = Statistics.of(position_errors(wide, start if again is None else again.x), other.data.pose)
    return found
