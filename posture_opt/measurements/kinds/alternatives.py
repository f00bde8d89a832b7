"""Which of two mountings an instrument has that suit the nominal arm alike: the one that errors of the arm explain."""

from __future__ import annotations

import numpy as np

from posture_opt.measurements.kinds.kind import Kind, Seen
from posture_opt.model.chain import Walk, position_column, rotation_column
from posture_opt.numerics import Array, Codes, stacked_rows
from posture_opt.robot.robot import Robot

_ERROR = 1e-3
"""rad or m, one standard deviation of every parameter of an arm: what its errors are reckoned with."""
_NOISE = 1e-5
"""rad or m, of a reading: small beside what errors of the arm do to it."""


def likeliest(kind: Kind, robot: Robot, reached: Walk, seen: Seen) -> Kind:
    """The kind, with those of its `Kind.alternatives` by which its rows are likelier.

    To first order the readings are off those of the nominal arm by ``r = J p + n``, p small errors of the arm and of
    what is unknown of the instrument, n noise: the likelier one has the lesser ``rᵀ (σ² + J S² Jᵀ)⁻¹ r``.

    Args:
        reached, seen: the nominal arm at all rows.
    """
    for i in range(len(kind.alternatives(seen))):
        other, rows = kind.alternatives(seen)[i]
        if _misfit(other, robot, reached, seen, rows) < _misfit(kind, robot, reached, seen, rows):
            kind = other
    return kind


def _misfit(kind: Kind, robot: Robot, reached: Walk, seen: Seen, rows: Codes) -> float:
    """``rᵀ (1 + A Aᵀ)⁻¹ r`` of some rows with ``A = J S / σ``, over σ²."""
    n = len(seen.place)
    names = [i for i, factor in enumerate(robot.factors) if factor.parameter]
    columns = [kind.slope(seen, position_column(reached, i), rotation_column(reached, i)) for i in names]
    axes = sorted({axis for place in kind.places(kind.names) for axis in kind.slots(place)})
    columns += [kind.unknown_slope(seen, axis) for axis in axes]
    r, *J = (stacked_rows(slots, n)[rows].ravel() for slots in (kind.error(seen), *columns))
    A: Array = np.stack(J, axis=1) * (_ERROR / _NOISE)
    left = A.T @ r
    return float(r @ r - left @ np.linalg.solve(np.eye(A.shape[1]) + A.T @ A, left))
