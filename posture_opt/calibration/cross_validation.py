"""Held-out errors: every group of rows predicted by an arm fitted to the others, exactly or to first order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.assumptions.frames import fit_frames
from posture_opt.calibration.estimation.fit import Fit, estimate_parameters
from posture_opt.calibration.estimation.least_squares import column_lengths
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.errors import InsufficientDataError, Issue
from posture_opt.numerics import Array, Codes, Mask, factored_columns, rms_length, thin_svd

_DETERMINED_SHARE = 1e-10  # of the largest singular value: what is smaller is not determined


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Residuals ``r + U K z`` for steps z of geometry and effects; every refit happens in the few coordinates K."""

    r: Array  # (m,) residuals at the estimate, those of known distances and of the prior at the end
    U: Array  # (m, p) orthonormal basis of all columns, ``K`` (p, c) the columns in it
    K: Array
    basis: Array  # (k, c) deviations of the parameters per step; shapes of effects stay
    owner: Codes  # (c,) the effect that a column belongs to; -1 for geometry
    z: Array  # (c,) the steps that the effects' estimates are; zero for geometry

    @classmethod
    def of(cls, fit: Fit) -> LinearModel:
        """The linear model of a fit at its estimate: geometry in the fitted steps, then the sizes of all effects."""
        r, J = fit.residuals_and_jacobian
        geometry, own = fit.directions[:, fit.geometry], fit.sizes
        scale = column_lengths(J[:, own])
        effects = np.zeros((len(fit.x), len(own)))
        effects[own, range(len(own))] = 1 / scale
        basis = np.concatenate([geometry, effects], axis=1)
        sizes = [s.stop - s.start for s in fit.slices]
        owner = np.r_[np.full(geometry.shape[1], -1), np.repeat(np.arange(len(sizes)), sizes)].astype(np.intp)
        z = np.r_[np.zeros(geometry.shape[1]), fit.x[own] * scale]
        return cls(r, *_in_own_space(J @ basis), basis, owner, z)

    @classmethod
    def with_columns(cls, fit: Fit, columns: Array) -> LinearModel:
        """Of the geometry of a fit and columns (m, c) that it was not fitted with, each of unit length."""
        r, J = fit.residuals_and_jacobian
        geometry = fit.directions[:, fit.geometry]
        further = np.zeros((len(r), columns.shape[1]))  # a prior of the geometry knows nothing of them
        further[: len(columns)] = columns
        U, K = _in_own_space(np.concatenate([J @ geometry, further], axis=1))
        count = geometry.shape[1] + columns.shape[1]
        basis = np.concatenate([geometry, np.zeros((len(fit.x), columns.shape[1]))], axis=1)
        return cls(r, U, K, basis, np.full(count, -1), np.zeros(count))

    def without(self, effect: int | None) -> tuple[Array, Codes]:
        """Residuals (m,) when an effect is taken out with nothing refitted, and the columns that are left."""
        gone = self.owner == effect if effect is not None else np.zeros(len(self.owner), dtype=bool)
        r = self.r - self.U @ (self.K[:, gone] @ self.z[gone]) if gone.any() else self.r
        return r, np.flatnonzero(~gone)

    def refitted(self, effect: int) -> Array:
        """(k,) deviations after which the rest explains what an effect leaves when it is taken out."""
        return np.asarray(self.basis @ self._step_without(effect))

    def left_without(self, effect: int) -> Array:
        """(m,) residuals when an effect is taken out and the rest fitted again."""
        return np.asarray(self.without(effect)[0] + self.U @ (self.K @ self._step_without(effect)))

    def _step_without(self, effect: int) -> Array:
        """(c,) the step of the rest when an effect is taken out; zero for the effect itself."""
        r, kept = self.without(effect)
        step = np.zeros(len(self.owner))
        step[kept] = np.linalg.lstsq(self.K[:, kept], -self.U.T @ r, rcond=_DETERMINED_SHARE)[0]
        return step


def _in_own_space(A: Array) -> tuple[Array, Array]:
    """An orthonormal basis U (m, p) of columns A (m, c), without directions that are not determined, and ``UᵀA``."""
    norms = np.linalg.norm(A, axis=0)
    # 1e-9 of the longest column: what is as long is more than rounding of others
    if norms.min(initial=1.0) > 1e-9 * norms.max(initial=0.0):
        factored = factored_columns(A / norms)
        if factored is not None:
            return factored[0], factored[1] * norms
    U, s, V = thin_svd(A)
    kept = s > _DETERMINED_SHARE * s.max(initial=0.0)
    return U[:, kept], s[kept, None] * V[kept]


Folds = Sequence[Codes]


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Position errors of every row by a model that has not seen its group, and whether they were expected."""

    errors: Array  # (N, 3) model minus measured [m], world
    inside: Mask  # (N,) in the 95 % region that the held-out errors of the other folds span
    # (N, axes, axes) covariance of noise at each row, up to a factor, where it is not the same at all rows
    shape: Array | None = None
    unsettled: int = 0  # how many fits did not converge

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

    Returns Errors (N, 3) [m] of every row, and whether it lies in its predicted 95 % region.
    """
    data = residuals.data
    errors, not_converged = np.zeros((len(data), 3)), 0
    for left_out in folds:
        learn = found.kept.copy()
        learn[left_out] = False
        if not learn.any():
            message = "leaving out what belongs together leaves no row to learn from, gross errors apart"
            raise InsufficientDataError(Issue(message, hint="measure more postures", file=data.file))
        training = residuals.take(np.flatnonzero(learn))
        x = fit_frames(training, found.x)
        if not frames:
            again = estimate_parameters(
                training, x, found.directions, found.prior, robust=False, near=found.minimum.x,
                weight=float(np.sqrt(found.design * found.variance)), design=found.design,
            )  # fmt: skip
            x, not_converged = again.x, not_converged + (not again.at_rest)
        if residuals.data.touches:
            errors[left_out] = residuals.data.held_out_touches(residuals.error(x))[left_out]
        else:
            errors[left_out] = position_errors(residuals.take(left_out), x)
        report_step()
    return HeldOut(errors, inside_regions(errors[:, residuals.axes], folds, found.kept), unsettled=not_converged)


def held_out(
    model: Fit, folds: Folds, without: int | None = None, shape: Array | None = None,
    about: LinearModel | None = None,
) -> HeldOut:  # fmt: skip
    """Errors of a model refitted to the other rows of each fold, to first order about its estimate."""
    linear = about or LinearModel.of(model)
    return linear_held_out_errors(model.residuals, [(left_out, linear) for left_out in folds], without, shape)


def linear_held_out_errors(
    residuals: Residuals, models: Iterable[tuple[Codes, LinearModel]], without: int | None = None,
    shape: Array | None = None,
) -> HeldOut:  # fmt: skip
    """Errors of the rows of each fold by its own linear model, fitted to the other rows; further arguments as above."""
    block, axes = residuals.block, residuals.axes
    errors, folds = np.zeros((len(residuals.data), 3)), []
    for left_out, linear in models:
        r, kept = linear.without(without)
        step, _ = refit_of_fold(linear, r, kept, residual_indices(left_out, block))
        refitted = r + linear.U @ (linear.K[:, kept] @ step)
        judged = residual_indices(judged_rows(residuals, left_out), block)
        errors[np.ix_(left_out, axes)] = positions_of(residuals, refitted[judged], left_out)
        folds.append(left_out)
    return HeldOut(errors, inside_regions(errors[:, axes], folds, shape=shape), shape)


def refit_of_fold(linear: LinearModel, r: Array, kept: Codes, left_out: Codes) -> tuple[Array, Array]:
    """The least squares step of columns ``kept`` for all residuals (m,) but those left out.

    In the orthonormal basis U of all rows, those that stay have the normal matrix ``I - FᵀF = V diag(e) Vᵀ`` where F is
    what U has in the rows left out: ``diag(√e) Vᵀ K`` replaces the columns in the rows that stay. Returned are the step
    and the root of its covariance (k, p), for residuals of variance one.
    """
    F, K = linear.U[left_out], linear.K[:, kept]
    values, V = np.linalg.eigh(np.eye(F.shape[1]) - F.T @ F)
    # 1e-13 of the information of all rows: what the rows that stay have less of, they do not have at all
    V, root = V[:, values > 1e-13], np.sqrt(values[values > 1e-13])
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
    """Errors (rows, axes) [m] of rows that a fit has not seen. r: residuals of `judged_rows`, (n·block,)."""
    judged = judged_rows(residuals, rows)
    e = residuals.metres(r.reshape(-1, residuals.block)[:, : len(residuals.axes)], judged)
    return residuals.data.held_out_touches(e)[rows] if residuals.data.touches else e


def inside_regions(e: Array, folds: Folds, kept: Mask | None = None, shape: Array | None = None) -> Mask:
    """(N,) whether held-out errors e (N, d) lie in 95 % regions spanned by those of the n rows of other folds.

    ``eᵀ C⁻¹ e ≤ d n / (n − d + 1) · F_{0.95}(d, n − d + 1)`` (Hotelling 1931) with ``C = Σ e eᵀ / n``. Errors of the
    training rows are smaller than C, and by an unknown factor where the model is wrong (CV+: Barber, Candès, Ramdas,
    Tibshirani 2021).

    Args:
        kept: (N,) rows that span regions, by default all.
        shape: (N, d, d) covariance of noise, up to a factor, where it is not the same at all rows.
    """
    from scipy.special import fdtri

    d, inside = e.shape[1], np.zeros(len(e), dtype=bool)
    if shape is not None:
        e = np.asarray(np.linalg.solve(np.linalg.cholesky(shape), e[:, :, None])[:, :, 0])
    for left_out in folds:
        others = np.ones(len(e), dtype=bool) if kept is None else kept.copy()
        others[left_out] = False
        n = max(np.count_nonzero(others), d + 1)
        # An arm measured in space may have no error at all across its plane: C is singular there.
        inverse = np.linalg.pinv(e[others].T @ e[others] / n, rcond=1e-12, hermitian=True)
        squared = np.einsum("ni,ij,nj->n", e[left_out], inverse, e[left_out])
        inside[left_out] = squared <= d * n / (n - d + 1) * fdtri(d, n - d + 1, 0.95)
    return inside


def position_errors(residuals: Residuals, x: Array) -> Array:
    """Position errors (N, 3) [m]; of touched points, about the mean of each point, which no one knows otherwise."""
    error = residuals.error(x)
    if residuals.data.touches:
        return residuals.data.about_points(error)
    error[:, np.setdiff1d(np.arange(3), residuals.axes)] = 0.0
    return error


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Errors on held-out rows with everything in the model, and with each part left out and all else fitted again."""

    whole: Array  # (N, axes) [m] with everything
    without: Array  # (parts, N, axes) [m]

    @property
    def gains(self) -> Array:
        """(parts,) relative drop of the RMS by each part, ``1 − RMS_whole / RMS_without``."""
        whole = rms_length(self.whole)
        return np.array([1 - whole / max(rms_length(e), 1e-300) for e in self.without])


def leave_out(residuals: Residuals, linear: LinearModel, folds: Folds, parts: Sequence[Codes]) -> LeftOut:
    """Errors of the rows of each fold by the model fitted to the others, whole and without some of its columns.

    With the estimate ``z`` of a fold and its covariance ``C`` (for residuals of variance one) the estimate under ``z_g
    = 0`` is ``z − C[:, g] C[g, g]⁻¹ z_g`` (Lawson, Hanson 1974, chapter 22).
    """
    n, axes, block = len(residuals.data), len(residuals.axes), residuals.block
    whole, without = np.zeros((n, axes)), np.zeros((len(parts), n, axes))
    every = np.arange(linear.K.shape[1])
    for left_out in folds:
        theirs = residual_indices(left_out, block)
        step, spread = refit_of_fold(linear, linear.r, every, theirs)
        seen = [_Seen.of(linear, spread, g) for g in parts]
        for g, part in zip(parts, seen, strict=True):
            step[g] = part.shown(step[g] + linear.z[g]) - linear.z[g]  # of what these rows do not show nothing is known
        judged = residual_indices(judged_rows(residuals, left_out), block)
        A = linear.U[judged] @ linear.K
        r = linear.r[judged] + A @ step
        whole[left_out] = positions_of(residuals, r, left_out)
        for i, (g, part) in enumerate(zip(parts, seen, strict=True)):
            less = spread @ part.weights(step[g] + linear.z[g])
            without[i, left_out] = positions_of(residuals, r - A @ less, left_out)
    return LeftOut(whole, without)


@dataclass(frozen=True, eq=False)
class _Seen:
    """What the rows of a fold show of a part, its columns counted in units of their length in all rows."""

    lengths: Array  # (p,) of the columns; ``root`` (p, r) of the covariance of their steps in that unit
    root: Array
    Q: Array  # Q, variances: (p, d) directions that are shown, and the variance of each (d,)
    variances: Array

    @classmethod
    def of(cls, linear: LinearModel, spread: Array, part: Codes) -> _Seen:
        """Of a part, with the root of the covariance of all steps."""
        lengths = np.maximum(np.linalg.norm(linear.K[:, part], axis=0), 1e-300)
        root = lengths[:, None] * spread[part]
        values, Q = np.linalg.eigh(root @ root.T)
        # 1e-8 of the step of a column of unit length, which is one where the rows show it: less is that of one they do
        # not show.
        kept = values > 1e-8
        return cls(lengths, root, Q[:, kept], values[kept])

    def shown(self, sizes: Array) -> Array:
        """(p,) sizes as far as they are shown."""
        return np.asarray(self.Q @ (self.Q.T @ (self.lengths * sizes)) / self.lengths)

    def weights(self, sizes: Array) -> Array:
        """(r,) by which the root of the covariance gives what sizes (p,) that become zero take along."""
        return np.asarray(self.root.T @ (self.Q @ (self.Q.T @ (self.lengths * sizes) / self.variances)))
