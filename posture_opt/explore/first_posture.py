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

    Without a place, the middle of all joints.
    """
    robot = problem.robot
    low, high = drawn_between(robot)
    if place is None:
        return np.asarray((low + high) / 2)
    Q = np.random.default_rng(0).uniform(low, high, (_POSTURES, robot.n))
    away = np.linalg.norm(np.asarray(problem.arm.position(Q)) - np.asarray(place, dtype=float), axis=1)
    Q = Q[np.argsort(away, kind="stable")[:_NEAREST]]
    return np.asarray(Q[int(np.argmax(problem.scene.least(Q) > 0.0))])
