"""The evidence of linear changes in Gaussian rows, exact at every noise level and size of a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.numerics import Array

NOISE_SPREAD = 0.2
NOISE_LEVELS = np.exp(NOISE_SPREAD * np.linspace(-2, 2, 7))
"""Noise over what instrument and scatter are stated as: known to 20 %."""


@dataclass(frozen=True, eq=False)
class GaussianRows:
    """Rows ``r = P u − A θ + ε``, u ~ N(0, I), ε ~ N(0, k² I), in coordinates in which ``k² I + P Pᵀ`` is diagonal.

    Args:
        r: (d,) residuals, model minus measurement; A: (d, K) derivatives of the model.
        e: (d,) eigenvalues of ``P Pᵀ``.
        rest: squared length of the residuals that no column reaches, in ``freedom`` dimensions.
    """

    r: Array
    A: Array
    e: Array
    rest: float
    freedom: int

    @classmethod
    def of(cls, r: Array, P: Array, A: Array) -> GaussianRows:
        """From whitened rows (m,), (m, p) and (m, K)."""
        Q, R = np.linalg.qr(np.concatenate([P, A], axis=1))
        inside = Q.T @ r
        known = R[:, : P.shape[1]]
        e, U = np.linalg.eigh(known @ known.T)
        rest = max(float(r @ r - inside @ inside), 0.0)
        return cls(U.T @ inside, U.T @ R[:, P.shape[1] :], np.maximum(e, 0.0), rest, len(r) - len(inside))

    def log_density(self, level: float) -> float:
        """``log p(r | θ = 0, k)`` at the noise level k, but for the constant of the dimension."""
        variance = level**2 + self.e
        inside = np.sum(self.r**2 / variance + np.log(variance))
        return -0.5 * float(inside + self.rest / level**2 + self.freedom * np.log(level**2))

    def normal_equations(self, level: float) -> tuple[Array, Array]:
        """``Aᵀ S⁻¹ A`` (K, K) and ``−Aᵀ S⁻¹ r`` (K,) under ``S = k² I + P Pᵀ``."""
        weighted = self.A / (level**2 + self.e)[:, None]
        return weighted.T @ self.A, -weighted.T @ self.r

    @cached_property
    def densities(self) -> Array:
        """(L,) log density of the rows with nothing changed, at each noise level."""
        return np.array([self.log_density(level) for level in NOISE_LEVELS])

    @cached_property
    def normal(self) -> list[tuple[Array, Array]]:
        """Normal equations at each noise level."""
        return [self.normal_equations(level) for level in NOISE_LEVELS]


@dataclass(frozen=True, eq=False)
class Estimate:
    """A Gaussian estimate: mean (p,) and covariance (p, p)."""

    mean: Array
    covariance: Array

    @classmethod
    def mixture(cls, parts: Sequence[Estimate], weights: Array) -> Estimate:
        """Mean and covariance of a mixture, the spread of its parts' means included."""
        means = np.array([part.mean for part in parts])
        mean = weights @ means
        off = means - mean
        inner = sum(w * part.covariance for w, part in zip(weights, parts, strict=True))
        return cls(mean, np.asarray(inner + (off * weights[:, None]).T @ off))


@dataclass(frozen=True, eq=False)
class SizedChange:
    """The change ``t ~ N(0, s² I / p)`` of root mean square motion s: evidence and estimate for any s.

    Args:
        G: (p, p) ``Bᵀ S⁻¹ B`` of the columns B of t; b: (p,) ``−Bᵀ S⁻¹ r``.
    """

    G: Array
    b: Array

    @cached_property
    def spectrum(self) -> tuple[Array, Array, Array]:
        """(p,) eigenvalues of G, (p, p) its eigenvectors, (p,) b in them."""
        values, V = np.linalg.eigh(self.G)
        return np.maximum(values, 0.0), V, V.T @ self.b

    def log_gains(self, sizes: Array) -> Array:
        """(S,) ``log p(r | s) − log p(r | θ = 0)`` at sizes s (S,) [m]."""
        values, _, z = self.spectrum
        return log_gains(values, z, sizes)

    def estimate(self, size: float) -> Estimate:
        """Mean and covariance of t at one size [m]."""
        values, V, z = self.spectrum
        variance = 1.0 / (values + len(self.b) / size**2)
        return Estimate(V @ (variance * z), (V * variance) @ V.T)


def log_gains(values: Array, z: Array, sizes: Array) -> Array:
    """(…, S) ``Σ_j ½ (v z_j² / (1 + v λ_j) − log(1 + v λ_j))``, ``v = s²/p``, for eigenvalues λ (p,) and z (…, p)."""
    v = sizes[:, None] ** 2 / len(values)
    fit = np.sum(v * z[..., None, :] ** 2 / (1 + v * values), axis=-1)
    return np.asarray(0.5 * (fit - np.sum(np.log1p(v * values), axis=-1)))


def log_sum(values: Array) -> float:
    """``log Σ exp v`` of numbers of any shape; −∞ of none."""
    if not np.size(values):
        return -np.inf
    top = float(np.max(values))
    return top + float(np.log(np.sum(np.exp(values - top)))) if np.isfinite(top) else -np.inf
