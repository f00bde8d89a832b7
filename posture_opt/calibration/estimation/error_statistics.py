"""Correlated position errors: figures of merit, groups, folds, and standard errors over blocks of rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from posture_opt.calibration.estimation.least_squares import reduced_jacobian, triangular_factor
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.errors import InputError, Issue
from posture_opt.limits import MOST_FOLDS
from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Json, linked, rms

By = Literal["pose", "block", "place", "stretch"]

_MAX_BOOTSTRAP_GROUPS = (
    10_000  # that a bootstrap draws from: the spread of a mean of more is known as well from sums of them
)
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
        lengths = np.linalg.norm(errors, axis=1)
        interval = _bootstrap_interval(lengths**2, groups, draws)
        largest, p95 = float(lengths.max()), float(np.quantile(lengths, 0.95))
        return cls(rms(lengths), float(lengths.mean()), largest, p95, interval)

    def to_json(self) -> dict[str, Json]:
        return {
            "rms": self.rms, "mean": self.mean, "max": self.max, "p95": self.p95, "rms_interval95": list(self.interval)
        }  # fmt: skip


def _bootstrap_interval(squares: Array, groups: Codes, draws: int) -> tuple[float, float]:
    """The 95 % percentile interval of the RMS [m] over resampled groups (Efron 1979), seeded.

    squares (N,) squared lengths [m²]; groups: (N,) codes.
    """
    group = resampled_groups(groups)
    total, count = np.bincount(group, squares), np.bincount(group)
    chosen = np.random.default_rng(0).integers(len(total), size=(draws, len(total)))
    means = total[chosen].sum(axis=1) / count[chosen].sum(axis=1)
    low, high = np.sqrt(np.quantile(means, [0.025, 0.975]))
    return float(low), float(high)


def resampled_groups(groups: Codes) -> Codes:
    """Codes (N,) from 0 on of groups (N,) that a bootstrap draws from; of very many, neighbours are one."""
    names, code = np.unique(groups, return_inverse=True)
    code = code.ravel()
    return np.asarray(
        code if len(names) <= _MAX_BOOTSTRAP_GROUPS else code * _MAX_BOOTSTRAP_GROUPS // len(names), dtype=np.intp
    )


def groups_of(data: Measurements, by: By, folds: int) -> Codes:
    """The group (N,) of each row: its pose, its place among touched points, its block of the workspace, or its stretch
    of a path.
    """
    if by == "place" and not data.touches:
        raise InputError(Issue("no point is touched whose place could be left out", hint="leave out by pose or block"))
    if by == "block" and data.position is None:
        raise InputError(Issue("no positions are measured to be cut into blocks", hint="leave out by place or pose"))
    if by == "place":
        places = [name.rpartition("/")[0] or name for name in data.point_names]
        codes = np.unique(places, return_inverse=True)[1]
        return np.asarray(codes[data.point], dtype=np.intp)
    if by == "stretch":
        stretches = np.empty(len(data), dtype=np.intp)
        stretches[data.order] = np.arange(len(data)) * 2 * folds // len(data)
        return stretches
    if by == "block":
        assert data.position is not None  # refused above
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
    data = residuals.data
    if data.lever is None:
        return 1.0
    numbers = np.bincount(np.unique(data.pose, return_inverse=True)[1].ravel()) * residuals.block
    # 6 of a rigid body
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
