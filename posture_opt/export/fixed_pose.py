"""The pose of fixed parts of a chain: origins of joints, base, tool."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from posture_opt.model.chain import factor_values, stack, walk
from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor


def fixed_pose(factors: Iterable[Factor]) -> Array:
    """(4, 4) the product of factors at the joint value zero, lengths in [m]."""
    still = [Factor(f.kind, f.axis, f.nominal) for f in factors]
    reached = walk(still, factor_values(still, ()))
    (a, b, c), x = reached.columns, reached.position
    rows = [(a[k], b[k], c[k], x[k]) for k in range(3)]
    return np.asarray(stack([*rows, (0.0, 0.0, 0.0, 1.0)]), dtype=float)
