"""Where the capsules of an arm stand in the world, in plain NumPy."""

from __future__ import annotations

import numpy as np

from tests.helpers.factors import frame, pose, product


def in_the_world(robot, q, capsule):
    """((3,), (3,), radius): both ends of a capsule's segment in the world [m]."""
    if capsule.joint == "base":
        T = product(robot.base, q)
    elif capsule.joint == "tool":
        T = pose(robot, q)
    else:
        T = frame(robot, q, robot.joint_names.index(capsule.joint))
    a, b = (T[:3, :3] @ np.array(end) + T[:3, 3] for end in (capsule.start, capsule.end))
    return a, b, capsule.radius


def from_segment(points, a, b):
    """(m,) distances [m] of points (m, 3) from the segment between ``a`` and ``b`` (3,)."""
    along = b - a
    t = np.clip((points - a) @ along / max(along @ along, 1e-30), 0.0, 1.0)
    return np.linalg.norm(points - a - t[:, None] * along, axis=1)
