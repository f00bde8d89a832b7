"""What a model gains where it has not seen the data: cross-validation of arms with and without effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.extended import Extended
from posture_opt.diagnosis.linear_model import LinearModel
from posture_opt.diagnosis.residuals import Residuals

Array = NDArray[np.float64]
Folds = Sequence[NDArray[np.intp]]

_NONE = 1e-13  # of the information of all rows: what the rows that stay have less of they do not have at all


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Position errors (N, 3) [m] of every row by a model that has not seen its group, and whether they were expected.

    ``inside`` (N,): in the 95 % region that the covariance of the errors taught by the other rows predicts; where noise
    is not the same at all rows, in the ``shape`` (N, axes, axes) that it has at each.
    """

    errors: Array
    inside: NDArray[np.bool_]
    shape: Array | None = None

    @property
    def rms(self) -> float:
        """Root mean square of the lengths [m]."""
        return float(np.sqrt(np.mean(np.sum(self.errors**2, axis=1))))


def held_out(
    model: Extended, folds: Folds, without: int | None = None, shape: Array | None = None,
    about: LinearModel | None = None,
) -> HeldOut:  # fmt: skip
    """Errors of a model refitted to the other rows of each fold, to first order about its estimate.

    About the estimate of all rows the model is linear to well below the noise: leaving a fold out moves a
    parameter by a fraction of its standard error. Shapes stay where they are. ``without`` leaves one effect out;
    ``about`` is the linear model where it is known.
    ``shape`` (N, axes, axes) is the covariance that noise gives the rows, up to a factor.
    """
    from scipy.special import gammaincinv

    residuals = model.residuals
    block, axes = residuals.block, len(residuals.axes)
    N = len(residuals.data)
    linear = about or LinearModel.of(model)
    r, kept = linear.without(without)
    errors, inside = np.zeros((N, 3)), np.zeros(N, dtype=bool)
    root = None if shape is None else np.asarray(np.linalg.cholesky(shape), dtype=float)
    for left_out in folds:
        theirs = _index(left_out, block)
        refitted = r + linear.U @ (linear.K[:, kept] @ _step(linear, r, kept, theirs))
        e = _positions(residuals, refitted[theirs], left_out)
        errors[np.ix_(left_out, residuals.axes)] = e
        learn = np.setdiff1d(np.arange(N), left_out)
        taught = refitted[_index(learn, block)].reshape(-1, block)[:, :axes] * residuals.sigma
        if root is not None:
            e, taught = _rounded(root[left_out], e), _rounded(root[learn], taught)
        freedom = max(len(taught) - len(kept) / 3, 1)
        C = taught.T @ taught / freedom
        # An arm in its plane may have no error at all across it: C is singular there.
        squared = np.einsum("ni,ni->n", e @ np.linalg.pinv(C, rcond=1e-12, hermitian=True), e)
        inside[left_out] = squared <= 2 * gammaincinv(axes / 2, 0.95)
    return HeldOut(errors, inside, shape)


def _rounded(root: Array, e: Array) -> Array:
    """Errors (n, d) in units of their own covariance ``root rootᵀ`` (n, d, d)."""
    return np.asarray(np.linalg.solve(root, e[:, :, None])[:, :, 0])


def _step(linear: LinearModel, r: Array, kept: NDArray[np.intp], left_out: NDArray[np.intp]) -> Array:
    """The least squares step of columns ``kept`` for all residuals (m,) but those left out.

    In the orthonormal basis U of all rows, those that stay have the normal matrix ``I - FᵀF = V diag(e) Vᵀ`` where F
    is what U has in the rows left out: ``diag(√e) Vᵀ K`` stands for the columns in the rows that stay.
    """
    F, K = linear.U[left_out], linear.K[:, kept]
    values, V = np.linalg.eigh(np.eye(F.shape[1]) - F.T @ F)
    V, root = V[:, values > _NONE], np.sqrt(values[values > _NONE])
    slope = V.T @ (linear.U.T @ r - F.T @ r[left_out])
    return np.asarray(np.linalg.lstsq(root[:, None] * (V.T @ K), -slope / root, rcond=1e-10)[0])


def _index(rows: NDArray[np.intp], block: int) -> NDArray[np.intp]:
    return np.asarray((rows[:, None] * block + np.arange(block)).ravel())


def _positions(residuals: Residuals, r: Array, rows: NDArray[np.intp]) -> Array:
    """(rows, axes) [m]; of touched points, about the mean of each point, which no one knows otherwise."""
    e = r.reshape(-1, residuals.block)[:, : len(residuals.axes)] * residuals.sigma
    if residuals.data.position is None:
        points = residuals.data.point[rows]
        for code in np.unique(points):
            e[points == code] -= e[points == code].mean(axis=0)
    return np.asarray(e)
