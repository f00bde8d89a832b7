"""Figures of merit of position errors, and the groups of rows that a cross-validation leaves out together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

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
        """Of errors (N, d) [m] whose rows are correlated within ``groups`` (N,).

        Args:
            draws: of the bootstrap.
        """
        lengths = np.linalg.norm(errors, axis=1)
        interval = _bootstrap_interval(lengths**2, groups, draws)
        largest, p95 = float(lengths.max()), float(np.quantile(lengths, 0.95))
        return cls(rms(lengths), float(lengths.mean()), largest, p95, interval)

    def to_json(self) -> dict[str, Json]:
        """Plain numbers [m]."""
        return {
            "rms": self.rms, "mean": self.mean, "max": self.max, "p95": self.p95, "rms_interval95": list(self.interval)
        }  # fmt: skip


def _bootstrap_interval(squares: Array, groups: Codes, draws: int) -> tuple[float, float]:
    """The 95 % percentile interval of the RMS [m] over resampled groups (Efron 1979), seeded.

    Args:
        squares: (N,) squared lengths [m²]; groups: (N,) codes.
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

    Poses within 1e-3 rad or m of each other are one, so that no fold is predicted by what it left out. The place of a
    point is its name up to a ``/``: ``front/0`` and ``front/1`` lie in one place.

    Raises:
        InputError: places of measured positions, or blocks of touched points.
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
    """Codes (N,) of the poses (N,), those with practically equal joint values (N, n) made one.

    Connected components of pairs that are within `_SAME_POSE_TOLERANCE` in every joint.
    """
    _, first, inverse = np.unique(pose, return_index=True, return_inverse=True)
    cell = np.zeros(len(first), dtype=np.intp)
    for column in np.round(q[first] / _SAME_POSE_TOLERANCE).T:  # of integers, joint by joint: much faster than of rows
        values, code = np.unique(column, return_inverse=True)
        cell = np.unique(cell * len(values) + code, return_inverse=True)[1]
    start = np.unique(cell, return_index=True)[1]
    return np.asarray(linked(q[first[start]], _SAME_POSE_TOLERANCE)[cell][inverse.ravel()], dtype=np.intp)


def median_blocks(points: Array, count: int) -> Codes:
    """Codes (N,) of so many blocks of points (N, d), cut along the longest side at the median again and again.

    The largest block is cut next, until there are ``count``; blocks of one point stay.
    """
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
    """The rows that each fold leaves out: whole groups, shuffled; every place is a fold of its own.

    Raises:
        InputError: more folds than are accepted.

    Example:
        >>> import numpy as np
        >>> [rows.tolist() for rows in folds_of(np.array([0, 0, 1, 1]), 2, "pose")]
        [[0, 1], [2, 3]]
    """
    names = np.unique(groups)
    if by == "place":
        return [np.flatnonzero(groups == name) for name in names]
    MOST_FOLDS.check_at(min(folds, len(names)), ("--folds",))
    shuffled = np.random.default_rng(seed).permutation(names)
    parts = [part for part in np.array_split(shuffled, folds) if len(part)]
    return [np.flatnonzero(np.isin(groups, part)) for part in parts]
