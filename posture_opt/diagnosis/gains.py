"""What a model gains where it has not seen the data: cross-validation of arms with and without effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.extended import Extended
from posture_opt.diagnosis.residuals import Residuals

Array = NDArray[np.float64]
Folds = Sequence[NDArray[np.intp]]


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


def held_out(model: Extended, folds: Folds, without: int | None = None, shape: Array | None = None) -> HeldOut:
    """Errors of a model refitted to the other rows of each fold, to first order about its estimate.

    About the estimate of all rows the model is linear to well below the noise: leaving a fold out moves a
    parameter by a fraction of its standard error. Shapes stay where they are. ``without`` leaves one effect out.
    ``shape`` (N, axes, axes) is the covariance that noise gives the rows, up to a factor.
    """
    from scipy.special import gammaincinv

    residuals = model.residuals
    block, axes = residuals.block, len(residuals.axes)
    N = len(residuals.data)
    r, A = _linear(model, without)
    errors, inside = np.zeros((N, 3)), np.zeros(N, dtype=bool)
    root = None if shape is None else np.asarray(np.linalg.cholesky(shape), dtype=float)
    for left_out in folds:
        learn = np.setdiff1d(np.arange(N), left_out)
        mine, theirs = _index(learn, block), _index(left_out, block)
        extra = np.arange(N * block, len(r))
        rows = np.concatenate([mine, extra])
        step = np.linalg.lstsq(A[rows], -r[rows], rcond=1e-10)[0]
        e = _positions(residuals, r[theirs] + A[theirs] @ step, left_out)
        errors[np.ix_(left_out, residuals.axes)] = e
        taught = (r[mine] + A[mine] @ step).reshape(-1, block)[:, :axes] * residuals.sigma
        if root is not None:
            e, taught = _rounded(root[left_out], e), _rounded(root[learn], taught)
        freedom = max(len(taught) - A.shape[1] / 3, 1)
        C = taught.T @ taught / freedom
        # An arm in its plane may have no error at all across it: C is singular there.
        squared = np.einsum("ni,ni->n", e @ np.linalg.pinv(C, rcond=1e-12, hermitian=True), e)
        inside[left_out] = squared <= 2 * gammaincinv(axes / 2, 0.95)
    return HeldOut(errors, inside, shape)


def _rounded(root: Array, e: Array) -> Array:
    """Errors (n, d) in units of their own covariance ``root rootᵀ`` (n, d, d)."""
    return np.asarray(np.linalg.solve(root, e[:, :, None])[:, :, 0])


def _linear(model: Extended, without: int | None) -> tuple[Array, Array]:
    """Residuals (m,) at the estimate and their derivatives by geometry and effects."""
    residuals = model.residuals
    r, J = residuals.both(model.x)
    rows = len(residuals.data) * residuals.block
    parts = [s for i, s in enumerate(model.suspects) if i != without]
    theta = [model.theta[part] for i, part in enumerate(model.slices) if i != without]
    Z = np.concatenate([np.zeros((rows, 0)), *(s.Z for s in parts)], axis=1)
    r = r.copy()
    r[:rows] += Z @ np.concatenate([np.zeros(0), *theta])
    wide = np.concatenate([Z, np.zeros((len(r) - rows, Z.shape[1]))])
    scale = np.linalg.norm(wide, axis=0)
    return r, np.concatenate([J @ model.directions, wide / np.where(scale > 0, scale, 1.0)], axis=1)


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
