"""Correlated errors as independent ones with a few shared factors: ``Σ = D + L Lᵀ``.

Given the factors ``z ~ N(0, I)`` the errors ``p = L z + e``, ``e ~ N(0, D)``, are independent, and every formula for
independent errors holds again. D is as large as can be, so that the factors are few: two correlated sources, or any
number with equal correlations ρ > 0, share one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from posture_opt.numerics import Array, Codes, Mask

_ZERO_EIGENVALUE = 1e-10
"""Eigenvalue of a matrix of correlations below which is rounding, or what the barrier left of a zero."""
_ROUNDING_EIGENVALUE = 1e-15
"""The same of rounding alone."""


@dataclass(frozen=True, eq=False)
class SharedFactors:
    """A covariance (k, k) split as ``diag(own) + loadings @ loadings.T``.

    Args:
        own: (k,) variances ≥ 0 of what every source has for itself [rad², m²].
        loadings: (k, r) standard deviation of each source by each factor [rad, m]; the factor that turns the chain the
            farthest is first. Each factor changes sources alone that are correlated with each other, and as many
            as can be change lengths alone.
    """

    own: Array
    loadings: Array

    @classmethod
    def of(cls, covariance: Array, turning: Mask) -> SharedFactors:
        """The split of a positive semidefinite covariance (k, k) of sources with variance, (k,) of them ``turning``.

        The diagonal maximises ``Σ_i D_ii / Σ_ii`` with ``D ⪰ 0`` and ``Σ − D ⪰ 0`` in every group of sources that are
        correlated with each other: minimum trace factor analysis of the matrix of correlations.

        Source: P. M. Bentler, J. A. Woodward, Inequalities among lower bounds to reliability, Psychometrika 45 (1980)
        249; A. Shapiro, Rank-reducibility of a symmetric matrix, Psychometrika 47 (1982) 187.
        """
        sigma = np.sqrt(np.diag(covariance))
        own = np.array(np.diag(covariance), dtype=float)
        columns: list[Array] = []
        for group in _correlated_groups(covariance):
            at = np.ix_(group, group)
            single, shared = _split_correlations(covariance[at] / np.outer(sigma[group], sigma[group]))
            own[group] = single * sigma[group] ** 2
            for column in _oriented_loadings(shared * sigma[group][:, None], turning[group]).T:
                loading = np.zeros(len(sigma))
                loading[group] = column
                columns.append(loading)
        order = sorted(range(len(columns)), key=lambda c: -float(np.linalg.norm(columns[c][turning])))
        return cls(own, np.array([columns[c] for c in order]).T if columns else np.zeros((len(sigma), 0)))

    @property
    def count(self) -> int:
        """r, how many factors there are."""
        return int(self.loadings.shape[1])


def _correlated_groups(covariance: Array) -> list[list[int]]:
    """The sources that are correlated with others; those that are linked by correlations in one list."""
    linked = covariance != 0
    left = [k for k in range(len(linked)) if np.count_nonzero(linked[k]) > 1]
    groups = []
    while left:
        group, reached = {left[0]}, [left[0]]
        while reached:
            near = set(np.flatnonzero(linked[reached.pop()]).tolist()) - group
            group |= near
            reached += near
        groups.append(sorted(group))
        left = [k for k in left if k not in group]
    return groups


def _split_correlations(R: Array) -> tuple[Array, Array]:
    """Diagonal (k,) and factors (k, r) of a matrix of correlations (k, k)."""
    if len(R) == 2:
        rho = max(-1.0, min(1.0, float(R[0, 1])))
        return np.full(2, 1 - abs(rho)), math.sqrt(abs(rho)) * np.array([[1.0], [math.copysign(1.0, rho)]])
    own = np.frombuffer(_kept_diagonal(R.tobytes(), len(R)))
    values, vectors = np.linalg.eigh(R - np.diag(own))
    # Errors that nearly cancel, as after a calibration, leave a combination with little variance: what is left out
    # must be little compared with that too.
    least = max(min(_ZERO_EIGENVALUE * len(R), 1e-6 * float(np.linalg.eigvalsh(R)[0])), _ROUNDING_EIGENVALUE * len(R))
    kept = np.flatnonzero(values > least)[::-1]
    shared = vectors[:, kept] * np.sqrt(values[kept])
    # What the smallest eigenvalues leave out of the diagonal goes back into it: the variances stay what they are.
    return np.maximum(np.diag(R) - (shared**2).sum(axis=1), 0.0), shared


def _oriented_loadings(L: Array, turning: Mask) -> Array:
    """The loadings (k, r) in other axes of the factors: as few as can be turn the chain, the first the farthest."""
    if L.shape[1] < 2 or not turning.any():
        return L
    _, sizes, axes = np.linalg.svd(L[turning])
    oriented: Array = L @ axes.T
    still = np.arange(L.shape[1]) >= np.count_nonzero(sizes > _ROUNDING_EIGENVALUE * len(L) * sizes[0])
    oriented[np.ix_(turning, still)] = 0.0
    # Where all sources turn the chain, a factor that does not is rounding.
    return oriented[:, oriented.any(axis=0)]


@lru_cache(maxsize=16)
def _kept_diagonal(packed: bytes, count: int) -> bytes:
    """`_largest_diagonal` of a matrix (``count``, ``count``): one arm is judged in many postures, each time anew."""
    return _largest_diagonal(np.frombuffer(packed).reshape(count, count)).tobytes()


def _largest_diagonal(R: Array) -> Array:
    """The diagonal d ≥ 0 of largest sum with ``R − diag(d)`` positive semidefinite, by a logarithmic barrier.

    Newton's method on ``Σ d + μ (log det Uᵀ (R − diag d) U + Σ log d)`` for μ → 0, U spanning the range of R. Where R
    has a null vector v, ``vᵀ (R − diag d) v ≥ 0`` leaves no diagonal to any source that v names.
    """
    values, vectors = np.linalg.eigh(R)
    null = values <= _ZERO_EIGENVALUE * len(R)
    # The square root of what is overlooked here comes back as an eigenvalue below zero.
    free = np.flatnonzero((vectors[:, null] ** 2).sum(axis=1) <= _ZERO_EIGENVALUE**2)
    d = np.zeros(len(R))
    if not len(free):
        return d
    U = vectors[:, ~null]
    d[free] = values[~null][0] / 2
    for power in range(14):
        former = d.copy()
        _centre_barrier(R, U, free, d, 10.0**-power)
        # Where the range of R hardly has some direction, rounding throws the steps out of the barrier.
        rest = np.linalg.eigvalsh(U.T @ (R - np.diag(d)) @ U) if np.isfinite(d).all() else np.array([-1.0])
        if rest[0] < -_ZERO_EIGENVALUE or np.any(d[free] <= 0):
            return former
    return d


def _centre_barrier(R: Array, U: Array, free: Codes, d: Array, mu: float) -> None:
    """Bring the free entries of d (changed in place) to the maximum of the barrier's function."""
    for _ in range(50):
        # (R - diag d)^-1 on the range of R; its square, entry by entry, is the Hessian of -log det.
        inverse = (U @ np.linalg.inv(U.T @ (R - np.diag(d)) @ U) @ U.T)[np.ix_(free, free)]
        gradient = 1 + mu * (1 / d[free] - np.diag(inverse))
        step = np.linalg.solve(mu * (inverse**2 + np.diag(1 / d[free] ** 2)), gradient)
        decrement = float(gradient @ step) / mu
        # The function is self-concordant: the damped step stays inside, and the last ones are whole.
        d[free] += step / (1 + math.sqrt(max(decrement, 0.0))) if decrement > 0.05 else step
        if decrement < 1e-8:
            return
