"""The ranges that random postures are drawn from."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from posture_opt.numerics import TURN, Array
from posture_opt.robot.robot import Robot


def drawn_between(robot: Robot, whole: Collection[int] = ()) -> tuple[Array, Array]:
    """(n,), (n,) the bounds [rad or m] that random postures are drawn between.

    The limits. Of a turning joint whose limits are more than a turn apart, the one turn within them whose middle is
    nearest to zero, as further turns repeat the same places: ``low = min(max(−π, lower), upper − 2π)``.

    Args:
        whole: indices of joints that are drawn between their limits however wide, as their turns are not alike.
    """
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    wide = np.array([joint.type == "revolute" for joint in robot.joints]) & (upper - lower > TURN)
    wide[list(whole)] = False
    low = np.where(wide, np.minimum(np.maximum(-np.pi, lower), upper - TURN), lower)
    return low, np.where(wide, low + TURN, upper)
