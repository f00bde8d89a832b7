"""Errors where nothing was seen: every group of rows predicted by an arm fitted to the others, or by another file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.error_statistics import Statistics
from posture_opt.calibration.fit import Fit, estimate
from posture_opt.calibration.fit_setup import FitSetup
from posture_opt.calibration.frames import check_other, fit_frames, frames_again
from posture_opt.calibration.residuals import Residuals
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Mask


@dataclass(frozen=True, eq=False)
class Predicted:
    """Every row by an arm that has not seen its group.

    Args:
        errors: (N, 3) of the position [m].
        inside: (N,) whether the row lies in the 95 % region that the arm predicts.
        restless: how many fits did not come to rest.
    """

    errors: Array
    inside: Mask
    restless: int


def predict(
    residuals: Residuals, folds: list[Codes], found: Fit, known: FitSetup | None, tell: Callable[[], None]
) -> Predicted:
    """Every row by an arm that was fitted to the other folds: all that is known to be fitted, or free frames alone.

    Args:
        found: the estimate from all rows: its outliers teach nothing, and the fits start near it.
        tell: is called after each fit.
    """
    data = residuals.data
    errors, inside, restless = np.zeros((len(data), 3)), np.zeros(len(data), dtype=bool), 0
    for left_out in folds:
        learn = found.kept.copy()
        learn[left_out] = False
        training = residuals.take(np.flatnonzero(learn))
        x = fit_frames(training)
        if known is not None:
            again = estimate(
                training, x, known.directions, known.prior, robust=False, near=found.minimum.x,
                weight=float(np.sqrt(known.design * found.variance)), design=known.design,
            )  # fmt: skip
            x, restless = again.x, restless + (not again.at_rest)
        rest = residuals.take(left_out)
        errors[left_out] = position_errors(rest, x)
        taught = position_errors(training, x)[:, residuals.axes]
        inside[left_out] = _inside(rest, errors[left_out], taught, x, None if known is None else again)
        tell()
    return Predicted(errors, inside, restless)


def _inside(rest: Residuals, errors: Array, taught: Array, x: Array, found: Fit | None) -> Mask:
    """Whether errors (n, 3) lie in the 95 % regions that other rows' errors ``taught`` (m, d) lead one to expect.

    They hold the scatter of those, and what is not known of the parameters; Hotelling's distribution, as the scatter
    itself is estimated.
    """
    e, d = errors[:, rest.axes], len(rest.axes)
    frames = sum(p.group != "geometry" for p in rest.parameters)
    fitted = frames if found is None else found.directions.shape[1]
    free = max(len(taught) - fitted / d, d + 1.0)
    C = np.broadcast_to(taught.T @ taught / free, (len(e), d, d))
    if found is not None:
        J = rest.both(x)[1][: len(e) * rest.block].reshape(len(e), rest.block, -1)[:, :d] * rest.sigma
        J = rest.data.about_points(J)
        C = C + J @ found.covariance @ np.swapaxes(J, -1, -2)
    return in_regions(e, C, free)


def in_regions(e: Array, C: Array, free: float) -> Mask:
    """(n,) whether errors e (n, d) lie in 95 % regions of covariances C (n, d, d) told by ``free`` other errors."""
    from scipy.special import fdtri

    d = e.shape[1]
    # An arm measured in space may have no error at all across its plane: C is singular there.
    inverse = np.linalg.pinv(C, rcond=1e-12, hermitian=True)
    squared = np.einsum("ni,nij,nj->n", e, inverse, e)
    return np.asarray(squared <= d * free / (free - d + 1) * fdtri(d, free - d + 1, 0.95))


def position_errors(residuals: Residuals, x: Array) -> Array:
    """Position errors (N, 3) [m]; of touched points, about the mean of each point, which no one knows otherwise."""
    error = residuals.error(x)
    if residuals.data.position is None:
        return residuals.data.about_points(error)
    error[:, ~residuals.data.measured_axes] = 0.0
    return error


def tested(
    residuals: Residuals, test: Measurements | None, x_nominal: Array, x: Array,
    refit: bool,
) -> dict[str, Statistics]:  # fmt: skip
    """The position errors of another file, predicted by ``x``, and by the arm as it stands.

    Raises:
        InputError: other targets, several robots, or too few poses to fit base and tool again.
    """
    if test is None:
        return {}
    check_other(residuals, test)
    other = residuals.of_data(test)
    models = {"nominal": x_nominal, "calibrated": x}
    seen = {name: frames_again(other, at) if refit else (other, at) for name, at in models.items()}
    return {name: Statistics.of(position_errors(*pair), test.pose) for name, pair in seen.items()}
