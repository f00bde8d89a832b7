"""``step_bounds``: how far each joint may move from point to point of a path, by its largest step and its speed."""

from __future__ import annotations

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.paths.joint_steps import JointSteps
from posture_opt.selection.paths.task_path import TaskPath

_MARGIN_RAD = 1e-9  # rad or m: what a solver may overstep
_MIN_STEP_RAD = 1e-12  # rad or m: no joint stands quite still


def step_bounds(steps: JointSteps, path: TaskPath, largest: float, speed: float | None) -> Array:
    """(K − 1, n) how far each joint may move between neighbours of the K points [rad or m].

    A step between listed points is divided evenly among the points added there. A joint that cannot leave its limits
    by that is not bounded by it, nor one without a known largest speed by ``speed``: infinity.

    Args:
        largest: change of any joint between listed points [rad or m].
        speed: of the tool point along the path [m/s]; None bounds nothing.
    """
    even = largest / np.asarray(path.parts, dtype=float)[:, None]
    even = np.where(steps.span > even, even, np.inf)
    most = even if speed is None else np.minimum(even, speed_bounds(steps, path, speed))
    return np.asarray(np.maximum(most - _MARGIN_RAD, _MIN_STEP_RAD))


def speed_bounds(steps: JointSteps, path: TaskPath, speed: float) -> Array:
    """(K − 1, n) how far each joint turns between the points at its largest speed, the tool at ``speed`` [m/s]."""
    velocities = np.array(steps.robot.velocities)
    each = np.diff(path.lengths)[:, None] / speed * velocities
    return np.asarray(np.where(np.isnan(each), np.inf, each))
