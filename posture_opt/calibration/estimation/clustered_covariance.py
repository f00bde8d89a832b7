"""Standard errors where neighbouring postures err alike: sums over blocks of rows in place of single rows.

What the model cannot express (a gear's error that comes round with every tooth, sag) is the same for postures that
lie close together. Taken as noise of independent rows, ten thousand of them would promise errors many times too small.
"""

from __future__ import annotations

import numpy as np

from posture_opt.calibration.estimation.error_statistics import median_blocks
from posture_opt.calibration.estimation.least_squares import reduced_jacobian, triangular_factor
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.numerics import Array, Codes

POSTURE_BLOCKS = 32  # of neighbouring postures: fewer make errors of errors, more separate what is correlated
_POSE_NUMBERS = 6  # of a rigid body
MIN_DESIGN_EFFECT = 1.5  # a smaller effect of the blocks is what independent rows show too


def neighbour_blocks(residuals: Residuals) -> Codes:
    """The block (N,) of neighbouring postures that each row lies in, `POSTURE_BLOCKS` of about equal size.

    Joints are scaled by their standard deviation and cut at medians, the longest side first. Rows of one picture have
    the scatter of the arm in common: pictures are not cut.
    """
    q, data = residuals.data.q, residuals.data
    spans = np.std(q, axis=0)
    scaled = q / np.where(spans > 0, spans, 1.0)
    if data.lever is None:
        return median_blocks(scaled, POSTURE_BLOCKS)
    _, first, picture = np.unique(data.pose, return_index=True, return_inverse=True)
    return median_blocks(scaled[first], POSTURE_BLOCKS)[picture.ravel()]


def design_effect(residuals: Residuals, rest: Array, J: Array) -> float:
    """How many times the variance of the estimates exceeds that of independent rows, on average; 1 up to chance.

    With ``J = U S Vᵀ`` the estimate errs by ``Uᵀ r`` in units of S: the squared sums of ``U r`` over the rows of each
    block, over those of single coordinates (Kish 1965). ``rest`` (m,) is what a step of all unknowns leaves.

    Args:
        rest: (m,) residuals of the rows; J: (m, k) their Jacobian.
    """
    R = triangular_factor(J)
    left, singular, _ = np.linalg.svd(R)
    kept = singular > 1e-12 * singular.max(initial=0.0)
    U = reduced_jacobian(J, np.asarray(np.linalg.pinv(R, rcond=1e-12) @ left[:, kept], dtype=float))
    together = np.sum(_block_sums(U * rest[:, None], residuals) ** 2, axis=0)
    single = np.sum((U * rest[:, None]) ** 2, axis=0)
    effect = float(np.mean(together / np.maximum(single, 1e-300))) if kept.any() else 1.0
    return effect * _lost_freedom(residuals, int(kept.sum())) if effect > MIN_DESIGN_EFFECT else 1.0


def _lost_freedom(residuals: Residuals, fitted: int) -> float:
    """By how much the errors of pictures are larger than a fit of some parameters leaves them; 1 of other rows.

    What pictures have in common is the pose of the tool at each of them: six numbers a picture, of which the fit took
    as many as it has parameters.
    """
    data = residuals.data
    if data.lever is None:
        return 1.0
    numbers = np.bincount(np.unique(data.pose, return_inverse=True)[1].ravel()) * residuals.block
    independent = float(np.minimum(numbers, _POSE_NUMBERS).sum())
    return independent / max(independent - fitted, 1.0)


def clustered_covariance(
    residuals: Residuals, r: Array, A: Array, R: Array, variance: float, known: Array, weight: float
) -> Array:  # fmt: skip
    """Covariance (p, p) of an estimate whose residuals are correlated within blocks: ``(AᵀA)⁻¹ Σ sᵢsᵢᵀ (AᵀA)⁻¹``.

    ``sᵢ`` is the sum of ``Aᵀ r`` over block i. No direction is taken as better known than by independent rows.

    Args:
        r: (m,) residuals; A: (m, p) their Jacobian, R: (p, p) its triangular factor, prior included.
        known: (n, p) rows of a prior, whose residuals are as large as their ``weight``.

    Source: Liang, Zeger (1986), equation 7; factor G / (G − 1) of G blocks.
    """
    scale = np.linalg.norm(R, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    P = np.asarray(np.linalg.pinv(R / scale, rcond=1e-14) / scale[:, None], dtype=float)
    sums = _block_sums(reduced_jacobian(A, P) * r[:, None], residuals)
    G = len(np.unique(neighbour_blocks(residuals)))
    M = sums.T @ sums * G / (G - 1) if G > 1 else np.zeros((len(P),) * 2)
    M = M * _lost_freedom(residuals, np.linalg.matrix_rank(A))
    KP = known @ P
    M = M + weight**2 * KP.T @ KP
    values, vectors = np.linalg.eigh(M)
    M = (vectors * np.maximum(values, variance)) @ vectors.T
    return np.asarray(P @ M @ P.T)


def _block_sums(scores: Array, residuals: Residuals) -> Array:
    """Sums (G, p) of scores (m, p) over the blocks of rows; a known distance, behind them, is a block of its own."""
    block = np.repeat(neighbour_blocks(residuals), residuals.block)
    apart = int(block.max(initial=-1)) + 1 + np.arange(len(scores) - len(block))
    block = np.concatenate([block, apart])
    sums = np.zeros((int(block.max(initial=0)) + 1, scores.shape[1]))
    np.add.at(sums, block, scores)
    return sums
