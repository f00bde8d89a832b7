"""The nominal arm at many postures, in plain NumPy."""

from __future__ import annotations

import numpy as np

from posture_opt.measurements.measurements import Floats
from posture_opt.model.chain import factor_values, stack, walk
from posture_opt.numerics import Mask
from posture_opt.robot.robot import Robot

_STILL = 1e-9  # m; rounding of half turns at a reach of metres is 1e-15


def nominal_poses(robot: Robot, q: Floats) -> tuple[Floats, Floats]:
    """Tool point (N, 3) [m] and rotation (N, 3, 3), both in the world, of postures (N, n)."""
    reached = walk(robot.factors, factor_values(robot.factors, [np.ascontiguousarray(column) for column in q.T]))
    points = np.broadcast_to(stack(reached.position), (len(q), 3))
    rotations = np.broadcast_to(stack(list(zip(*reached.columns, strict=True))), (len(q), 3, 3))
    return np.asarray(points), np.asarray(rotations)


def reach_of(robot: Robot) -> Floats:
    """(32, 3) where the tool point comes to lie at postures drawn at random [m]."""
    q = np.random.default_rng(0).uniform(np.array(robot.lower), np.array(robot.upper), (32, robot.n))
    return nominal_poses(robot, q)[0]


def still_axes(robot: Robot) -> Mask:
    """(3,) along which world axes the tool point cannot move at will, as z of a planar arm."""
    points = reach_of(robot)
    # A planar arm that was found to be slightly skew leaves its plane by its flaws only.
    extent = np.ptp(points, axis=0)
    return np.asarray(extent < _STILL + 2 * robot.skew * extent.max())
