"""A fitted arm to first order about its estimate, in the coordinates of the space that its columns span."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.diagnosis.extended_fit import Extended, with_known
from posture_opt.numerics import Array, Codes

_LEAST = 1e-10  # of the largest singular value: what is smaller is not determined


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Residuals ``r + U K z`` for steps z of geometry and effects; every refit happens in the few coordinates K.

    Args:
        r: (m,) residuals at the estimate, those of known distances and of stated σ's at the end.
        U: (m, p) orthonormal basis of all columns, ``K`` (p, k) the columns in it.
        scale: (k,) by which the columns of effects were divided.
        owner: (k,) the effect that a column belongs to; -1 for geometry.
        theta: (k,) estimate of the effects, zero for geometry, in units of the columns.
    """

    r: Array
    U: Array
    K: Array
    scale: Array
    owner: Codes
    theta: Array

    @classmethod
    def of(cls, model: Extended) -> LinearModel:
        """Of a model at its estimate."""
        residuals = model.residuals
        r, J = with_known(residuals, model.x, model.known)
        rows, g = len(residuals.data) * residuals.block, model.directions.shape[1]
        r[:rows] += model.columns @ model.theta
        wide = np.concatenate([model.columns, np.zeros((len(r) - rows, len(model.theta)))])
        norms = np.linalg.norm(wide, axis=0)
        scale = np.where(norms > 0, norms, 1.0)
        owner = [np.full(part.stop - part.start, i) for i, part in enumerate(model.slices)]
        U, s, V = np.linalg.svd(np.concatenate([J @ model.directions, wide / scale], axis=1), full_matrices=False)
        kept = s > _LEAST * s.max(initial=0.0)
        return cls(
            r, U[:, kept], s[kept, None] * V[kept], np.r_[np.ones(g), scale],
            np.concatenate([np.full(g, -1), *owner]).astype(np.intp), np.r_[np.zeros(g), model.theta * scale],
        )  # fmt: skip

    def without(self, effect: int | None) -> tuple[Array, Codes]:
        """Residuals (m,) when an effect is taken out with nothing refitted, and the columns that are left."""
        gone = self.owner == effect if effect is not None else np.zeros(len(self.owner), dtype=bool)
        r = self.r - self.U @ (self.K[:, gone] @ self.theta[gone]) if gone.any() else self.r
        return r, np.flatnonzero(~gone)

    def refitted(self, effect: int) -> Array:
        """(k,) step of every column after which the rest explains what an effect leaves when it is taken out."""
        r, kept = self.without(effect)
        step = np.zeros(len(self.owner))
        step[kept] = np.linalg.lstsq(self.K[:, kept], -self.U.T @ r, rcond=_LEAST)[0]
        return step / self.scale
