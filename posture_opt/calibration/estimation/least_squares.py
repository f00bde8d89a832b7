"""Nonlinear least squares with honest errors, for any function that returns residuals and Jacobian."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array, Mask

Function = Callable[[Array], tuple[Array, Array]]


OUTLIER_MARGIN = 1.5
"""Of the largest of as many Gaussian residuals, by which a row is an outlier: real ones have longer tails."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """The minimum of ``½ |r(x)|²``."""

    x: Array  # (k,) the estimate
    residuals: Array  # (m,) there
    R: Array  # (k, k) triangular factor of the Jacobian there, ``RᵀR = JᵀJ``
    variance: float  # residual variance, ``|r|² / (m − k)``
    steps: int  # iterations taken
    converged: bool  # whether the relative offset or the step fell below rounding

    @property
    def covariance(self) -> Array:
        """``s² (JᵀJ)⁻¹`` (k, k); directions the residuals do not see add nothing."""
        inverse, _ = self._inverse()
        return np.asarray(self.variance * inverse @ inverse.T)

    @property
    def std(self) -> Array:
        """(k,) standard errors of the estimate, infinite where the residuals do not see all of it."""
        inverse, unseen = self._inverse()
        return np.where(unseen > 1e-6, np.inf, np.sqrt(self.variance) * np.linalg.norm(inverse, axis=1))

    def _inverse(self) -> tuple[Array, Array]:
        """``R⁺`` and the part (k,) of each unknown outside it."""
        D = column_lengths(self.R)
        U, s, Vt = np.linalg.svd(self.R / D)
        seen = s > 1e-14 * s.max(initial=0.0)
        inverse = (Vt[seen].T / s[seen]) @ U[:, seen].T / D[:, None]
        return np.asarray(inverse), np.asarray(np.sum(Vt[~seen] ** 2, axis=0))


def least_squares(function: Function, x0: Array, *, max_steps: int = 500, tolerance: float = 1e-10) -> Minimum:
    """Levenberg-Marquardt on the QR factors of the Jacobian, never on ``JᵀJ``.

    Each step solves ``min |J s + r|² + λ |D s|²`` with ``D`` the largest column norms so far (Moré 1978) and the
    damping of Nielsen (1999); it ends where ``|Qᵀr| / √k`` is ``tolerance`` of ``|r − QQᵀr| / √(m − k)``. Where the
    first step fails, the next is no longer than ``x0`` itself, lest it end on a plateau far away.

    function: x (k,) -> residuals (m,) and Jacobian (m, k).
    """
    x = np.array(x0, dtype=float)
    r, J = function(x)
    D, damping = np.zeros(len(x)), 1e-3
    for step in range(max_steps):
        R = triangular_factor(np.concatenate([J, r[:, None]], axis=1))
        R, projected = R[: len(x), :-1], R[: len(x), -1]
        D = np.maximum(D, np.linalg.norm(J, axis=0))
        D = np.where(D > 0, D, 1.0)
        lower = None
        if not _at_rest(projected, r, tolerance):
            lower = _descent_step(function, x, r, R, projected, D, damping, step == 0)
        if lower is None:
            return _minimum_at(x, r, R, step, True)
        move, r_new, J_new, damping = lower
        expected, gained = _expected_gain(R, projected, move), float(r @ r - r_new @ r_new)
        ratio = 1.0 if gained >= expected else gained / expected
        damping = max(damping * max(1 / 3, 1 - float(2 * ratio - 1) ** 3), 1e-15)
        x, r, J = x + move, r_new, J_new
    return _minimum_at(x, r, triangular_factor(J), max_steps, False)


def _descent_step(
    function: Function, x: Array, r: Array, R: Array, projected: Array, D: Array, damping: float, first: bool
) -> tuple[Array, Array, Array, float] | None:
    reach, growth = np.inf, 2.0
    while True:
        # min |R s + Qᵀr|² + λ |D s|², in units of D
        stacked = np.concatenate([R, np.diag(np.sqrt(damping) * D)]) / D
        target = np.concatenate([-projected, np.zeros(len(D))])
        move = np.asarray(np.linalg.lstsq(stacked, target, rcond=None)[0] / D)
        length = np.linalg.norm(D * move)
        if length > reach:
            damping *= 2
            continue
        # 1e-14: relative step at which floating point has nothing left to improve
        if length <= 1e-14 * (np.linalg.norm(D * x) + 1e-14):
            return None
        with np.errstate(all="ignore"):
            r_new, J_new = function(x + move)
            gain = r @ r - r_new @ r_new
        if np.isfinite(gain) and np.all(np.isfinite(J_new)) and gain > 0:
            return move, r_new, J_new, damping
        # 1e-13 of |r|²: a step that promised no more, and failed, failed by rounding
        if _expected_gain(R, projected, move) <= 1e-13 * (r @ r):
            return None
        damping, growth = damping * growth, growth * 2
        if first and np.any(x):
            reach = float(np.linalg.norm(D * x))


def column_lengths(A: Array) -> Array:
    """(k,) norms of columns (m, k); 1 for zero columns, so that one can divide by them."""
    norms = np.linalg.norm(A, axis=0)
    return np.where(norms > 0, norms, 1.0)


def triangular_factor(A: Array) -> Array:
    """The (k, k) factor ``R`` of ``A = Q R`` (m, k), block by block of rows (Demmel et al. 2012)."""
    m, k = A.shape
    if k == 0:  # nothing is free
        return np.zeros((0, 0))
    size = 4 * k  # blocks that fit the cache are faster than one long matrix, and too small for threads to fight over
    while len(A) > 2 * size:
        whole = len(A) // size * size
        factors = np.asarray(np.linalg.qr(A[:whole].reshape(-1, size, k), mode="r"))
        A = np.concatenate([factors.reshape(-1, k), A[whole:]])
    R = np.linalg.qr(A, mode="r")
    return np.asarray(np.concatenate([R, np.zeros((max(k - m, 0), k))]))


def reduced_jacobian(J: Array, directions: Array) -> Array:
    """``J @ directions`` (m, r), by blocks of 64 rows."""
    whole = len(J) // 64 * 64
    blocks = J[:whole].reshape(whole // 64, 64, J.shape[1]) @ directions
    return np.concatenate([blocks.reshape(whole, directions.shape[1]), J[whole:] @ directions])


def _expected_gain(R: Array, projected: Array, move: Array) -> float:
    """By how much a step (k,) would lower ``|r|²`` if the tangent were the function."""
    return float(np.sum(projected**2) - np.sum((projected + R @ move) ** 2))


def _at_rest(projected: Array, r: Array, tolerance: float) -> bool:
    """Whether the residuals (m,) are orthogonal to the tangent plane: ``projected`` (k,) is ``Qᵀ r``.

    Source: Bates, Watts (1981), the relative offset criterion.
    """
    m, k = len(r), len(projected)
    if not k:
        return True  # nothing is free
    inside, total = float(projected @ projected), float(r @ r)
    if m <= k or total == 0:
        return total == 0
    outside = max(total - inside, 0.0)
    return inside / k <= tolerance**2 * outside / (m - k)


def _minimum_at(x: Array, r: Array, R: Array, steps: int, converged: bool) -> Minimum:
    return Minimum(x, r, R, float(r @ r) / max(len(r) - len(x), 1), steps, converged)


def find_outliers(
    residuals: Array, J: Array, block: int, known: Array | None = None, margin: float = OUTLIER_MARGIN
) -> tuple[Mask, Array]:
    """Which rows, of ``block`` residuals each, are gross outliers, and the studentised length (N,) of each row.

    The residuals of row i have the covariance ``s² (I − H_ii)``, ``H = J (JᵀJ)⁻¹ Jᵀ``; ``s`` is taken from the median
    of ``r_iᵀ (I − H_ii)⁻¹ r_i``, which outliers cannot move far. Gross is what Gaussian residuals would reach once in a
    thousand samples of this size, times ``margin``. ``known`` are further rows of J, of a prior.
    """
    squared = _inflated_squares(residuals, J, block, known)
    with np.errstate(over="ignore"):  # beside rows that are met exactly any other is infinitely far off
        studentised = np.sqrt(squared / _robust_variance(squared, block))
    return studentised > outlier_limit(len(squared), block, margin), studentised


def outlier_limit(rows: int, block: int, margin: float = OUTLIER_MARGIN) -> float:
    """The studentised length of a row of ``block`` residuals, of so many rows, beyond which it is an outlier."""
    from scipy.special import gammainccinv

    return margin * float(np.sqrt(2 * gammainccinv(block / 2, 1e-3 / rows)))


def unexplained_residuals(residuals: Array, J: Array) -> Array:
    """What is left of the residuals (m,) after the best step of the unknowns, to first order.

    J (m, k) Jacobian.
    """
    k = J.shape[1]
    R = triangular_factor(np.concatenate([J, residuals[:, None]], axis=1))
    return np.asarray(residuals - J @ np.linalg.lstsq(R[:, :k], R[:, k], rcond=1e-12)[0])


def robust_noise(residuals: Array, J: Array, block: int) -> float:
    """Standard deviation of what no step of the unknowns explains, whatever a few outliers say; 0 where too few."""
    if len(J) <= J.shape[1]:
        return 0.0
    return float(np.sqrt(_robust_variance(_inflated_squares(unexplained_residuals(residuals, J), J, block), block)))


def _inflated_squares(residuals: Array, J: Array, block: int, known: Array | None = None) -> Array:
    """``r_iᵀ (I − H_ii)⁻¹ r_i`` (N,) of rows of ``block`` residuals."""
    n = len(residuals) // block
    R = triangular_factor(J if known is None else np.concatenate([J, known]))
    inverse = np.asarray(np.linalg.pinv(R, rcond=1e-14), dtype=float)
    Q = reduced_jacobian(J, inverse).reshape(n, block, J.shape[1])
    r = residuals.reshape(n, block)
    leverage = Q @ np.swapaxes(Q, -1, -2)
    inflated = np.linalg.solve(np.eye(block) * (1 + 1e-9) - leverage, r[..., None])[..., 0]
    return np.asarray(np.maximum(np.einsum("ni,ni->n", r, inflated), 0.0))


def _robust_variance(squared: Array, block: int) -> float:
    """The variance of Gaussian residuals with this median of squared lengths (N,), ``block`` coordinates each."""
    from scipy.special import gammaincinv

    return max(float(np.median(squared)) / (2 * float(gammaincinv(block / 2, 0.5))), 1e-300)
