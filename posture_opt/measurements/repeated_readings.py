"""How far readings of one posture scatter: an upper bound of the instrument's noise that needs no model of the arm."""

from __future__ import annotations

import numpy as np

from posture_opt.measurements.measurements import Measurements, outlying_groups, rows_of
from posture_opt.measurements.repeats import repeat_groups
from posture_opt.robot.robot import Robot

MIN_FREEDOM = 12
"""Degrees of freedom from which a standard deviation is used: it is then known to a fifth."""
_COPY_TOLERANCE_M = 1e-9
"""Readings that agree to less are one reading written twice."""


def repeated_readings(data: Measurements, robot: Robot) -> tuple[float, int]:
    """Standard deviation of a coordinate between readings of one posture [m], and its degrees of freedom; 0, 0 without.

    ``s² = Σ |x − mean|² / Σ d (n_g − 1)`` over groups of n_g readings of d coordinates. It holds the instrument's noise
    and what the arm changes from repeat to repeat. Postures whose readings differ far more than those of the others are
    left out.
    """
    if data.position is None:
        return 0.0, 0
    points = data.position[:, data.measured_axes]
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    codes = repeat_groups(data, slides)
    if data.payload is not None:
        codes = np.unique(np.column_stack([codes, data.payload]), axis=0, return_inverse=True)[1].ravel()
    groups = [points[rows] for rows in rows_of(codes) if len(rows) > 1]
    size = np.array([np.sum((p - p.mean(axis=0)) ** 2) for p in groups])
    freedom = np.array([points.shape[1] * (len(p) - 1) for p in groups], dtype=float)
    used = size > freedom * _COPY_TOLERANCE_M**2
    size, freedom = size[used], freedom[used]
    kept = ~outlying_groups(size, freedom)
    total = int(freedom[kept].sum())
    return (float(np.sqrt(size[kept].sum() / total)), total) if total else (0.0, 0)
