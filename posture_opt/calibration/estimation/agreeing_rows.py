"""Rows that look gross but agree: targets or repeats of one posture that are off alike show an error of the arm."""

from __future__ import annotations

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Mask

_MAX_DISAGREEMENT = 0.5
"""Share of the larger of two errors by which they may differ: two gross errors of readings, in any direction and of
sizes alike, agree so by chance in one pair of fifteen at the most (the share of a sphere within 30 deg).
"""


def agreeing_rows(data: Measurements, errors: Array, gross: Mask) -> Mask:
    """(N,) which gross rows are off by nearly as much as another target or repeat of the same posture.

    ``0 < |e_i − e_j| ≤ max(|e_i|, |e_j|) / 2`` for a gross row i and another gross row j of the same pose, as most of
    the targets of that posture, or of its rows where there is one target: a reading that failed does not recur, what
    the arm does is in all of them. Copies of a row do not confirm it.

    Args:
        errors: (N, k) of the measured coordinates, in one unit.
        gross: (N,) rows that look like outliers.
    """
    agree = np.zeros(len(data), dtype=bool)
    unit = data.target if len(data.target_names) > 1 else np.arange(len(data))
    poses, count = np.unique(data.pose[gross], return_counts=True)
    for pose in poses[count > 1]:
        rows = np.flatnonzero(data.pose == pose)
        off = rows[gross[rows]]
        near = [i for i in off if _alike(unit, errors, i, off)]
        if 2 * len(set(unit[near])) > len(set(unit[rows])):
            agree[near] = True
    return agree


def _alike(unit: Codes, errors: Array, i: int, others: Codes) -> bool:
    """Whether a row of another unit errs as row i does."""
    rest = others[unit[others] != unit[i]]
    lengths = np.linalg.norm(errors, axis=1)
    apart = np.linalg.norm(errors[rest] - errors[i], axis=1)
    return bool(np.any((apart > 0) & (apart <= _MAX_DISAGREEMENT * np.maximum(lengths[rest], lengths[i]))))
