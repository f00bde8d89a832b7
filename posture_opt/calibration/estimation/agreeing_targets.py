"""Rows that look gross but agree: several targets of one posture that are off alike show an error of the arm."""

from __future__ import annotations

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.numerics import Array, Codes, Mask

_MAX_DISAGREEMENT = 0.5
"""Share of the larger of two errors by which they may differ: two gross errors of readings, in any direction and of
sizes alike, agree so by chance in one pair of fifteen at the most (the share of a sphere within 30 deg).
"""


def agreeing_targets(data: Measurements, errors: Array, gross: Mask) -> Mask:
    """(N,) which gross rows are off by nearly as much as another target that was measured in the same posture.

    ``|e_i − e_j| ≤ max(|e_i|, |e_j|) / 2`` for a gross row i and another gross row j of the same pose and
    another target, as most of the targets of that posture: a reading that failed does not recur with another reflector,
    what the arm does moves all of them.

    Args:
        errors: (N, k) of the measured coordinates, in one unit.
        gross: (N,) rows that look like outliers.
    """
    agree = np.zeros(len(data), dtype=bool)
    if len(data.target_names) < 2 or np.count_nonzero(gross) < 2:
        return agree
    for pose in np.unique(data.pose[gross]):
        rows = np.flatnonzero(data.pose == pose)
        off = rows[gross[rows]]
        near = [i for i in off if _alike(data.target, errors, i, off)]
        if 2 * len(set(data.target[near])) > len(set(data.target[rows])):
            agree[near] = True
    return agree


def _alike(target: Codes, errors: Array, i: int, others: Codes) -> bool:
    """Whether a row of another target errs as row i does."""
    rest = others[target[others] != target[i]]
    lengths = np.linalg.norm(errors, axis=1)
    apart = np.linalg.norm(errors[rest] - errors[i], axis=1)
    return bool(np.any(apart <= _MAX_DISAGREEMENT * np.maximum(lengths[rest], lengths[i])))
