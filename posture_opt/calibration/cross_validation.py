"""Errors where nothing was seen: every group of rows predicted by an arm fitted to the others, or by another file.

The others are fitted anew, exactly (`refitted_errors`), or to first order about the fit to all rows (`held_out`). Every
fold then fits geometry and the sizes of effects; where effects were chosen by the same rows, their choice belongs into
the folds too (`linear_held_out_errors`, by models of their own).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.assumptions.frames import fit_frames
from posture_opt.calibration.estimation.fit import Fit, estimate_parameters
from posture_opt.calibration.estimation.linear_model import LinearModel
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.errors import InsufficientDataError, Issue
from posture_opt.numerics import Array, Codes, Mask, rms_length

Folds = Sequence[Codes]

_INFORMATION_TOLERANCE = (
    1e-13  # of the information of all rows: what the rows that stay have less of they do not have at all
)


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Position errors of every row by a model that has not seen its group, and whether they were expected.

    Args:
        errors: (N, 3) model minus measured [m], world.
        inside: (N,) in the 95 % region that the errors of the other rows lead one to expect, and what these leave
            unknown of the parameters.
        shape: (N, axes, axes) covariance of noise at each row, up to a factor, where it is not the same at all rows.
        unsettled: how many fits did not converge.
    """

    errors: Array
    inside: Mask
    shape: Array | None = None
    unsettled: int = 0

    @property
    def rms(self) -> float:
        """Root mean square of the lengths [m]."""
        return rms_length(self.errors)

    def take(self, rows: Codes) -> HeldOut:
        """Those of ``rows``, indices."""
        shape = None if self.shape is None else self.shape[rows]
        return replace(self, errors=self.errors[rows], inside=self.inside[rows], shape=shape)


def refitted_errors(
    residuals: Residuals,
    folds: Folds,
    found: Fit,
    report_step: Callable[[], None] = lambda: None,
    *,
    frames: bool = False,
) -> HeldOut:
    """Every row by an arm that was fitted to the other folds: all that was fitted to all rows, or free frames alone.

    Args:
        found: the estimate from all rows: its outliers teach nothing, and the fits start near it.
        report_step: is called after each fit.
        frames: fit free frames and nothing else.
        residuals: the arm against all rows, outliers included; folds: the rows that each leaves out.

    Returns:
        Errors (N, 3) [m] of every row, and whether it lies in its predicted 95 % region.

    Raises:
        InsufficientDataError: a fold leaves none of the rows that count.
    """
    data = residuals.data
    errors, inside, not_converged = np.zeros((len(data), 3)), np.zeros(len(data), dtype=bool), 0
    for left_out in folds:
        learn = found.kept.copy()
        learn[left_out] = False
        if not learn.any():
            message = "leaving out what belongs together leaves no row to learn from, gross errors apart"
            raise InsufficientDataError(Issue(message, hint="measure more postures", file=data.file))
        training = residuals.take(np.flatnonzero(learn))
        x = fit_frames(training, found.x)
        again = None
        if not frames:
            again = estimate_parameters(
                training, x, found.directions, found.prior, robust=False, near=found.minimum.x,
                weight=float(np.sqrt(found.design * found.variance)), design=found.design,
            )  # fmt: skip
            x, not_converged = again.x, not_converged + (not again.at_rest)
        errors[left_out] = _held_out_errors(residuals, x, left_out)
        taught = position_errors(training, x)[:, residuals.axes]
        inside[left_out] = _inside_regions(residuals, left_out, errors[left_out], taught, x, again)
        report_step()
    return HeldOut(errors, inside, unsettled=not_converged)


def held_out(
    model: Fit, folds: Folds, without: int | None = None, shape: Array | None = None,
    about: LinearModel | None = None,
) -> HeldOut:  # fmt: skip
    """Errors of a model refitted to the other rows of each fold, to first order about its estimate.

    The cost is one eigendecomposition (p, p) a fold, p the number of columns, in place of a nonlinear fit.

    About the estimate of all rows the model is linear to well below the noise: leaving a fold out moves a
    parameter by a fraction of its standard error. Shapes stay where they are. ``without`` leaves one effect out;
    ``about`` is the linear model where it is known.
    ``shape`` (N, axes, axes) is the covariance that noise gives the rows, up to a factor.
    """
    linear = about or LinearModel.of(model)
    return linear_held_out_errors(model.residuals, [(left_out, linear) for left_out in folds], without, shape)


def linear_held_out_errors(
    residuals: Residuals, models: Iterable[tuple[Codes, LinearModel]], without: int | None = None,
    shape: Array | None = None,
) -> HeldOut:  # fmt: skip
    """Errors of the rows of each fold by its own linear model, fitted to the other rows; further arguments as above."""
    N, block = len(residuals.data), residuals.block
    errors, inside = np.zeros((N, 3)), np.zeros(N, dtype=bool)
    root = None if shape is None else np.asarray(np.linalg.cholesky(shape), dtype=float)
    for left_out, linear in models:
        r, kept = linear.without(without)
        theirs = residual_indices(left_out, block)
        step, spread = refit_of_fold(linear, r, kept, theirs)
        refitted = r + linear.U @ (linear.K[:, kept] @ step)
        e = positions_of(residuals, refitted[residual_indices(judged_rows(residuals, left_out), block)], left_out)
        errors[np.ix_(left_out, residuals.axes)] = e
        unit_steps = linear.U @ (linear.K[:, kept] @ spread)
        inside[left_out] = in_regions(e, *_expected_covariance(residuals, refitted, unit_steps, left_out, root))
    return HeldOut(errors, inside, shape)


def _expected_covariance(
    residuals: Residuals, r: Array, unit_steps: Array, left_out: Codes, root: Array | None
) -> tuple[Array, float]:
    """Covariance (n, axes, axes) [m²] of the errors of n rows left out, and how many others it is estimated from.

    Noise as the other rows have it, and the error of the parameters fitted to them: the leverage of a row. A parameter
    takes from each coordinate what its leverage there is.

    Args:
        r: (m,) residuals by the refitted model.
        unit_steps: (m, p) columns for parameters of variance one each, for residuals of variance one.
        root: (N, axes, axes) of the covariance of noise, up to a factor, where it is not the same at all rows.
    """
    N, block, d = len(residuals.data), residuals.block, len(residuals.axes)
    learn = np.setdiff1d(np.arange(N), left_out)
    taught = residuals.metres(r[: N * block].reshape(N, block)[learn, :d], learn)
    rows = unit_steps[: N * block].reshape(N, block, -1)[:, :d]
    free = max(len(learn) - float(np.sum(rows[learn] ** 2)) / d, d + 1.0)
    if root is not None:
        taught = np.asarray(np.linalg.solve(root[learn], taught[:, :, None])[:, :, 0])
    C = np.broadcast_to(taught.T @ taught / free, (len(left_out), d, d))
    if root is not None:
        C = root[left_out] @ C @ np.swapaxes(root[left_out], -1, -2)
    others = np.delete(r, residual_indices(left_out, block))
    variance = float(others @ others) / max(len(others) - unit_steps.shape[1], 1)
    L = residuals.data.held_out_touches(residuals.metres(rows))[left_out]
    return C + variance * L @ np.swapaxes(L, -1, -2), free


def refit_of_fold(linear: LinearModel, r: Array, kept: Codes, left_out: Codes) -> tuple[Array, Array]:
    """The least squares step of columns ``kept`` for all residuals (m,) but those left out.

    In the orthonormal basis U of all rows, those that stay have the normal matrix ``I - FᵀF = V diag(e) Vᵀ`` where F
    is what U has in the rows left out: ``diag(√e) Vᵀ K`` replaces the columns in the rows that stay. Returned are the
    step and the root of its covariance (k, p), for residuals of variance one.
    """
    F, K = linear.U[left_out], linear.K[:, kept]
    values, V = np.linalg.eigh(np.eye(F.shape[1]) - F.T @ F)
    V, root = V[:, values > _INFORMATION_TOLERANCE], np.sqrt(values[values > _INFORMATION_TOLERANCE])
    slope = V.T @ (linear.U.T @ r - F.T @ r[left_out])
    spread = np.linalg.pinv(root[:, None] * (V.T @ K), rcond=1e-10)
    return np.asarray(spread @ (-slope / root)), np.asarray(spread)


def residual_indices(rows: Codes, block: int) -> Codes:
    """Indices of the residuals of some rows, ``block`` each."""
    return np.asarray((rows[:, None] * block + np.arange(block)).ravel())


def judged_rows(residuals: Residuals, rows: Codes) -> Codes:
    """The rows whose residuals `positions_of` needs for the errors of ``rows``: of touched points all of them."""
    return np.arange(len(residuals.data)) if residuals.data.touches else rows


def positions_of(residuals: Residuals, r: Array, rows: Codes) -> Array:
    """Errors (rows, axes) [m] of rows that a fit has not seen.

    The place of a touched point is not known: errors count from the mean of all its touches, see
    `Measurements.held_out_touches`. From that of the few that one fold leaves out they would be too small.

    Args:
        r: residuals of `judged_rows`, (n·block,).
    """
    judged = judged_rows(residuals, rows)
    e = residuals.metres(r.reshape(-1, residuals.block)[:, : len(residuals.axes)], judged)
    return residuals.data.held_out_touches(e)[rows] if residuals.data.touches else e


def _held_out_errors(residuals: Residuals, x: Array, rows: Codes) -> Array:
    """Position errors (rows, 3) [m] of rows that a fit has not seen; of touched points as `positions_of` has them."""
    if not residuals.data.touches:
        return position_errors(residuals.take(rows), x)
    return residuals.data.held_out_touches(residuals.error(x))[rows]


def _inside_regions(
    residuals: Residuals, rows: Codes, errors: Array, taught: Array, x: Array, found: Fit | None
) -> Mask:
    """Whether errors (n, 3) of ``rows`` lie in the 95 % regions that other rows' errors ``taught`` (m, d) lead one to
    expect.

    They hold the scatter of those, and what is not known of the parameters; Hotelling's distribution, as the scatter
    itself is estimated.
    """
    e, d = errors[:, residuals.axes], len(residuals.axes)
    frames = sum(p.group != "geometry" for p in residuals.parameters)
    fitted = frames if found is None else found.spent
    free = max(len(taught) - fitted / d, d + 1.0)
    C = np.broadcast_to(taught.T @ taught / free, (len(e), d, d))
    if found is not None:
        used = residuals.take(judged_rows(residuals, rows))
        J = used.residuals_and_jacobian(x)[1][: used.measured].reshape(len(used.data), used.block, -1)[:, :d]
        J = used.data.held_out_touches(used.metres(J))
        J = J[rows] if used.data.touches else J
        C = C + J @ found.covariance @ np.swapaxes(J, -1, -2)
    return in_regions(e, C, free)


def in_regions(e: Array, C: Array, free: float) -> Mask:
    """(n,) whether errors e (n, d) lie in 95 % regions of covariances C (n, d, d) estimated from ``free`` other errors.

    ``eᵀ C⁻¹ e ≤ d ν / (ν − d + 1) · F_{0.95}(d, ν − d + 1)`` (Hotelling 1931) with ν = ``free``.
    """
    from scipy.special import fdtri

    d = e.shape[1]
    # An arm measured in space may have no error at all across its plane: C is singular there.
    inverse = np.linalg.pinv(C, rcond=1e-12, hermitian=True)
    squared = np.einsum("ni,nij,nj->n", e, inverse, e)
    return np.asarray(squared <= d * free / (free - d + 1) * fdtri(d, free - d + 1, 0.95))


def position_errors(residuals: Residuals, x: Array) -> Array:
    """Position errors (N, 3) [m]; of touched points, about the mean of each point, which no one knows otherwise."""
    error = residuals.error(x)
    if residuals.data.touches:
        return residuals.data.about_points(error)
    error[:, np.setdiff1d(np.arange(3), residuals.axes)] = 0.0
    return error
