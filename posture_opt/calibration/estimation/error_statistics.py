"""Correlated position errors: figures of merit, groups, folds, and standard errors over blocks of rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from posture_opt.calibration.estimation.least_squares import column_lengths, reduced_jacobian, triangular_factor
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.errors import InputError, Issue
from posture_opt.limits import MOST_FOLDS
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Json, linked, rms

By = Literal["pose", "block", "place", "stretch"]

_SAME_POSE_TOLERANCE = 1e-3  # rad or m: postures nearer than that have the same errors, whatever their pose is called


@dataclass(frozen=True)
class Statistics:
    """Lengths of position errors [m]; ``interval`` is the 95 % bootstrap interval of the RMS over groups of rows."""

    rms: float
    mean: float
    max: float
    p95: float
    interval: tuple[float, float]

    @classmethod
    def of(cls, errors: Array, groups: Codes, draws: int = 500) -> Statistics:
        """Of errors (N, d) [m] whose rows are correlated within ``groups`` (N,)."""
        lengths, group = np.linalg.norm(errors, axis=1), resampled_groups(groups)
        # The percentile interval of resampled groups (Efron 1979), seeded.
        total, count = np.bincount(group, lengths**2), np.bincount(group)
        chosen = np.random.default_rng(0).integers(len(total), size=(draws, len(total)))
        means = total[chosen].sum(axis=1) / count[chosen].sum(axis=1)
        low, high = np.sqrt(np.quantile(means, [0.025, 0.975])).tolist()
        p95 = float(np.quantile(lengths, 0.95))
        return cls(rms(lengths), float(lengths.mean()), float(lengths.max()), p95, (low, high))

    def to_json(self) -> dict[str, Json]:
        own = {name: value for name, value in vars(self).items() if name != "interval"}
        return {**own, "rms_interval95": list(self.interval)}


def resampled_groups(groups: Codes) -> Codes:
    """Codes (N,) from 0 on of groups (N,) that a bootstrap draws from; of very many, neighbours are one."""
    names, code = np.unique(groups, return_inverse=True)
    # 10 000 groups: the spread of a mean of more is known as well from sums of them
    few = code.ravel() if len(names) <= 10_000 else code.ravel() * 10_000 // len(names)
    return np.asarray(few, dtype=np.intp)


def groups_of(data: Measurements, by: By, folds: int) -> Codes:
    """Group (N,) of each row: its pose, place, block of the workspace, or stretch of a path."""
    if by == "place" and not data.touches:
        raise InputError(Issue("no point is touched whose place could be left out", hint="leave out by pose or block"))
    if by == "block" and data.position is None:
        raise InputError(Issue("no positions are measured to be cut into blocks", hint="leave out by place or pose"))
    if by == "place":
        places = [name.rpartition("/")[0] or name for name in data.point_names]
        return np.asarray(np.unique(places, return_inverse=True)[1][data.point], dtype=np.intp)
    if by == "stretch":
        stretches = np.empty(len(data), dtype=np.intp)
        stretches[data.order] = np.arange(len(data)) * 2 * folds // len(data)
        return stretches
    if by == "block" and data.position is not None:
        return median_blocks(data.position, 4 * folds)
    return equal_poses(data.q, data.pose)


def equal_poses(q: Array, pose: Codes) -> Codes:
    """Codes (N,) of the poses (N,), those with practically equal joint values (N, n) made one."""
    _, first, inverse = np.unique(pose, return_index=True, return_inverse=True)
    cell = np.zeros(len(first), dtype=np.intp)
    for column in np.round(q[first] / _SAME_POSE_TOLERANCE).T:  # of integers, joint by joint: much faster than of rows
        values, code = np.unique(column, return_inverse=True)
        cell = np.unique(cell * len(values) + code, return_inverse=True)[1]
    start = np.unique(cell, return_index=True)[1]
    return np.asarray(linked(q[first[start]], _SAME_POSE_TOLERANCE)[cell][inverse.ravel()], dtype=np.intp)


def median_blocks(points: Array, count: int) -> Codes:
    """Codes (N,) of so many blocks of points (N, d), cut along the longest side at the median again and again."""
    parts = [np.arange(len(points))]
    while len(parts) < count:
        largest = max(range(len(parts)), key=lambda i: len(parts[i]))
        rows = parts.pop(largest)
        if len(rows) < 2:
            parts.append(rows)
            break
        rows = rows[np.argsort(points[rows, np.argmax(np.ptp(points[rows], axis=0))], kind="stable")]
        parts += [rows[: len(rows) // 2], rows[len(rows) // 2 :]]
    codes = np.zeros(len(points), dtype=np.intp)
    for code, rows in enumerate(parts):
        codes[rows] = code
    return codes


def folds_of(groups: Codes, folds: int, by: By, seed: int = 0) -> list[Codes]:
    """The rows that each fold leaves out: whole groups, shuffled; every place is a fold of its own."""
    names = np.unique(groups)
    if by == "place":
        return [np.flatnonzero(groups == name) for name in names]
    MOST_FOLDS.check_at(min(folds, len(names)), ("--folds",))
    shuffled = np.random.default_rng(seed).permutation(names)
    parts = [part for part in np.array_split(shuffled, folds) if len(part)]
    return [np.flatnonzero(np.isin(groups, part)) for part in parts]


POSTURE_BLOCKS = 32  # of neighbouring postures: fewer make errors of errors, more separate what is correlated


def neighbour_blocks(residuals: Residuals) -> Codes:
    """The block (N,) of neighbouring postures that each row lies in, `POSTURE_BLOCKS` of about equal size."""
    q, data = residuals.data.q, residuals.data
    spans = np.std(q, axis=0)
    scaled = q / np.where(spans > 0, spans, 1.0)
    if data.lever is None:
        return median_blocks(scaled, POSTURE_BLOCKS)
    # Rows of one picture have the scatter of the arm in common: pictures are not cut.
    _, first, picture = np.unique(data.pose, return_index=True, return_inverse=True)
    return median_blocks(scaled[first], POSTURE_BLOCKS)[picture.ravel()]


def design_effect(residuals: Residuals, rest: Array, J: Array) -> float:
    """How many times the variance of the estimates exceeds that of independent rows, on average; 1 up to chance.

    With ``J = U S Vᵀ`` the estimate errs by ``Uᵀ r`` in units of S: the squared sums of ``U r`` over the rows of each
    block, over those of single coordinates (Kish 1965). ``rest`` (m,) is what a step of all unknowns leaves.

    rest (m,) residuals of the rows; J: (m, k) their Jacobian.
    """
    R = triangular_factor(J)
    left, singular, _ = np.linalg.svd(R)
    kept = singular > 1e-12 * singular.max(initial=0.0)
    U = reduced_jacobian(J, np.asarray(np.linalg.pinv(R, rcond=1e-12) @ left[:, kept], dtype=float))
    together = np.sum(_block_sums(U * rest[:, None], residuals) ** 2, axis=0)
    single = np.sum((U * rest[:, None]) ** 2, axis=0)
    effect = float(np.mean(together / np.maximum(single, 1e-300))) if kept.any() else 1.0
    # 1.5 a smaller effect of the blocks is what independent rows show too
    return effect * _lost_freedom(residuals, int(kept.sum())) if effect > 1.5 else 1.0


def _lost_freedom(residuals: Residuals, fitted: int) -> float:
    """By how much errors of pictures exceed what a fit of some parameters leaves; 1 of other rows."""
    data = residuals.data
    if data.lever is None:
        return 1.0
    # Pictures have the pose of the tool in common: six numbers each, of which the fit took one a parameter.
    numbers = np.bincount(np.unique(data.pose, return_inverse=True)[1].ravel()) * residuals.block
    independent = float(np.minimum(numbers, 6).sum())
    return independent / max(independent - fitted, 1.0)


def clustered_covariance(
    residuals: Residuals, r: Array, A: Array, R: Array, variance: float, known: Array, weight: float
) -> Array:  # fmt: skip
    """Covariance (p, p) of an estimate whose residuals are correlated within blocks: ``(AᵀA)⁻¹ Σ sᵢsᵢᵀ (AᵀA)⁻¹``.

    ``sᵢ`` is the sum of ``Aᵀ r`` over block i. No direction is taken as better known than by independent rows.

    Source: Liang, Zeger (1986), equation 7; factor G / (G − 1) of G blocks.

    r (m,) residuals; A: (m, p) their Jacobian, R: (p, p) its triangular factor, prior included; known (n, p) rows of a
    prior, whose residuals are as large as their ``weight``.
    """
    scale = column_lengths(R)
    P = np.asarray(np.linalg.pinv(R / scale, rcond=1e-14) / scale[:, None], dtype=float)
    sums = _block_sums(reduced_jacobian(A, P) * r[:, None], residuals)
    G = len(np.unique(neighbour_blocks(residuals)))
    M = sums.T @ sums * G / (G - 1) if G > 1 else np.zeros((len(P),) * 2)
    KP = known @ P
    M = M * _lost_freedom(residuals, np.linalg.matrix_rank(A)) + weight**2 * KP.T @ KP
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
