"""A fitted arm to first order about its estimate, in the coordinates of the space that its columns span."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.numerics import Array, Codes, factored_columns, thin_svd

_RANK_TOLERANCE = 1e-10  # of the largest singular value: what is smaller is not determined
_CLEAR_LENGTH = 1e-9  # of the longest column: what is as long is more than rounding of others


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Residuals ``r + U K z`` for steps z of geometry and effects; every refit happens in the few coordinates K.

    Args:
        r: (m,) residuals at the estimate, those of known distances and of the prior at the end.
        U: (m, p) orthonormal basis of all columns, ``K`` (p, c) the columns in it.
        basis: (k, c) deviations of the parameters per step; shapes of effects stay.
        owner: (c,) the effect that a column belongs to; -1 for geometry.
        z: (c,) the steps that the effects' estimates are; zero for geometry.
    """

    r: Array
    U: Array
    K: Array
    basis: Array
    owner: Codes
    z: Array

    @classmethod
    def of(cls, fit: Fit) -> LinearModel:
        """The linear model of a fit at its estimate: geometry in the fitted steps, then the sizes of all effects."""
        r, J = fit.residuals_and_jacobian
        geometry = fit.directions[:, fit.geometry]
        own = fit.sizes
        norms = np.linalg.norm(J[:, own], axis=0)
        scale = np.where(norms > 0, norms, 1.0)
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
        r, _ = self.without(effect)
        return np.asarray(r + self.U @ (self.K @ self._step_without(effect)))

    def _step_without(self, effect: int) -> Array:
        """(c,) the step of the rest when an effect is taken out; zero for the effect itself."""
        r, kept = self.without(effect)
        step = np.zeros(len(self.owner))
        step[kept] = np.linalg.lstsq(self.K[:, kept], -self.U.T @ r, rcond=_RANK_TOLERANCE)[0]
        return step


def _in_own_space(A: Array) -> tuple[Array, Array]:
    """An orthonormal basis U (m, p) of columns A (m, c), without directions that are not determined, and ``UᵀA``."""
    norms = np.linalg.norm(A, axis=0)
    if norms.min(initial=1.0) > _CLEAR_LENGTH * norms.max(initial=0.0):
        factored = factored_columns(A / norms)
        if factored is not None:
            return factored[0], factored[1] * norms
    U, s, V = thin_svd(A)
    kept = s > _RANK_TOLERANCE * s.max(initial=0.0)
    return U[:, kept], s[kept, None] * V[kept]
