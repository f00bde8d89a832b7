"""``posture_near``: what the page shows of the arm, pale, until the first answer is there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from posture_opt.numerics import Array
from posture_opt.problem.problem import Problem
from posture_opt.robot.joint_ranges import drawn_between

_POSTURES = 2000  # random ones: takes some ms
_NEAREST = 50  # of which those that are clear of the cell are preferred


def posture_near(problem: Problem, place: Sequence[float] | None) -> Array:
    """A posture (n,) [rad or m] whose tool point is near a place [m]: of random ones the nearest that is clear.

    Without a place, near the middle of all that the tool point reaches in front, where x is not negative.
    """
    robot = problem.robot
    low, high = drawn_between(robot)
    Q = np.random.default_rng(0).uniform(low, high, (_POSTURES, robot.n))
    points = np.asarray(problem.arm.position(Q))
    middle = points[points[:, 0] >= min(0.0, points[:, 0].max())].mean(axis=0) if place is None else np.asarray(place)
    away = np.linalg.norm(points - middle, axis=1)
    Q = Q[np.argsort(away, kind="stable")[:_NEAREST]]
    return np.asarray(Q[int(np.argmax(problem.scene.least(Q) > 0.0))])
