"""Postures that are the same up to a few degrees: one answer and not many."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from posture_opt.numerics import TURN, Array, Codes
from posture_opt.robot.robot import Robot

DISTINCT_ANGLE = math.radians(5.0)  # apart in a joint: well above what a search leaves open in a flat valley
DISTINCT_STROKE = 0.01  # m, the same of a slide
ROWS_PER_BLOCK = 64  # postures that are compared with all others at once: bounds the memory


def clusters(Q: Array, robot: Robot, size: Codes | None = None, ignored: Sequence[int] = ()) -> tuple[Codes, Codes]:
    """Rows of Q (k, n) that differ from every earlier one, and how many rows, ``size`` each, differ from them by less.

    By more than 5° or 10 mm in a joint, whole turns apart; the joints ``ignored`` make no difference.

    Args:
        Q: (k, n) postures [rad or m], best first: the first of a cluster represents it.
        size: (k,) how many searches each row represents; default one.
    """
    joints = [k for k in range(robot.n) if k not in ignored]
    revolute = np.array([robot.joints[k].type == "revolute" for k in joints], dtype=bool)[:, None]
    limit, turn = np.where(revolute, DISTINCT_ANGLE, DISTINCT_STROKE)[..., None], np.where(revolute, TURN, 0.0)
    X = Q.T[joints]
    X -= turn * np.rint(X / TURN)  # angles within half a turn of zero are near, or a turn but a little apart
    beyond = np.where(revolute, TURN, np.inf)[..., None] - limit
    left, cluster = np.ones(len(Q), dtype=bool), np.zeros(len(Q), dtype=int)
    first: list[int] = []
    for block in range(0, len(Q), ROWS_PER_BLOCK):
        apart = np.abs(X[:, block : block + ROWS_PER_BLOCK, None] - X[:, None])
        near = np.logical_and.reduce((apart <= limit) | (apart >= beyond))
        for k, row in enumerate(near, start=block):
            if left[k]:
                row &= left
                cluster[row] = len(first)
                first.append(k)
                left ^= row
    return np.array(first, dtype=int), np.bincount(cluster, size, len(first)).astype(int)
