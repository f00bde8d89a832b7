"""The ranges that random postures are drawn from."""

from __future__ import annotations

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot


def drawn_between(robot: Robot) -> tuple[Array, Array]:
    """(n,), (n,) the bounds [rad or m] that random postures are drawn between.

    The limits; of a turning joint at most (−π, π) of them, as further turns repeat the same places. A joint whose
    limits do not meet that turn keeps its own limits.
    """
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    low, high = np.maximum(lower, -np.pi), np.minimum(upper, np.pi)
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    whole = slides | (low >= high)
    return np.where(whole, lower, low), np.where(whole, upper, high)
