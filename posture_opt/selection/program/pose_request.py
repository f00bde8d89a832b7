"""``PoseRequest``: what the inverse kinematics is to reach for a target, row by row of a batch.

A request is numbers only, so that one compiled step serves targets of every kind.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.program.task_target import FREE, TaskTarget

PARTS = (0, 3, 6, 9, 12, 15, 16)
"""Where position, axis, spin, weights, slack and cone of a request begin."""
WIDTH = PARTS[-1]
"""Numbers of one request."""
_INSIDE = 0.999  # of the tilt: an axis drawn a little inside the cone satisfies the row, an inequality


@dataclass(frozen=True)
class PoseRequest:
    """What every row of a batch is to reach, as weighted residuals.

    Args:
        position: (N, 3) or (3,) wanted tool point [m].
        axis: (N, 3) or (3,) wanted direction of the tool axis, world.
        spin: (N, 3) or (3,) wanted direction of the tool's spin vector, world.
        weights: (3,) for position, axis and spin; zero leaves a part out.
        slack: (N, 3) or (3,) half sides of a box about ``position`` [m] that is as good as the point.
        cone: (N, 1) or (1,) distance of unit vectors within which an axis is as good as ``axis``.
    """

    position: Array
    axis: Array
    spin: Array
    weights: Array
    slack: Array = field(default_factory=lambda: np.zeros(3))
    cone: Array = field(default_factory=lambda: np.zeros(1))

    @property
    def rows(self) -> Array:
        """(N, 16) or (1, 16) all parts side by side, as the step takes them."""
        parts = (self.position, self.axis, self.spin, self.weights, self.slack, self.cone)
        rows = np.empty((max(len(part) if part.ndim == 2 else 1 for part in parts), WIDTH))
        for part, first in zip(parts, PARTS, strict=False):
            rows[:, first : first + part.shape[-1]] = part
        return rows


def request_for(
    target: TaskTarget,
    count: int,
    aligned: bool,
    rng: np.random.Generator,
    *,
    whole_box: bool = False,
    slack_of_axis: float = 0.0,
) -> PoseRequest:
    """Targets for ``count`` starts: the point, or points drawn from the region; axes drawn within the tilt.

    Args:
        aligned: whether the tool axis is asked for.
        rng: what points and axes are drawn with.
        whole_box: any point of the region will do: an arm with few joints cannot align its tool at a drawn one, while
            an arm with many is pushed to the region's edge.
        slack_of_axis: error of the tool axis that is as good as none [rad].
    """
    anywhere = target.kind == "anywhere"
    position, slack = np.zeros(3) if anywhere else target.lower, np.zeros(3)
    if target.kind == "region":
        # Half of the starts aim at drawn points; the others take any point, as a branch must that reaches a part only.
        position = rng.uniform(target.lower, target.upper, (count, 3))
        any_point = np.full(count, True) if whole_box else np.arange(count) // 2 % 2 == 1
        position[any_point] = (target.lower + target.upper) / 2
        slack = np.where(any_point[:, None], (target.upper - target.lower) / 2, 0.0)
    axis, cone = target.axis, np.array([slack_of_axis])
    if aligned and target.tilt > 0:
        # Half of the starts aim at drawn axes; the others take any axis of the cone, as an arm must that cannot
        # turn its tool everywhere.
        axis, any_axis = _within_tilt(target, count, rng), np.arange(count) % 2 == 1
        axis[any_axis] = target.axis
        cone = np.where(any_axis, 2 * np.sin(_INSIDE * target.tilt / 2), 0.0)[:, None]
    weights = np.array([0.0 if anywhere else 1.0, 1.0 if aligned else 0.0, float(target.spun)])
    assert np.all(np.abs(position) < FREE)
    return PoseRequest(position, axis, target.spin, weights, slack, cone)


def held_request(target: TaskTarget, aligned: bool, slack_of_axis: float) -> PoseRequest:
    """What holds a posture on its target and no more: any point of a region, any axis within the tilt."""
    anywhere = target.kind == "anywhere"
    middle, half = (target.lower + target.upper) / 2, (target.upper - target.lower) / 2
    weights = np.array([0.0 if anywhere else 1.0, 1.0 if aligned else 0.0, float(target.spun)])
    cone = max(2 * np.sin(target.tilt / 2), slack_of_axis)
    return PoseRequest(middle, target.axis, target.spin, weights, half, np.array([cone]))


def _within_tilt(target: TaskTarget, count: int, rng: np.random.Generator) -> Array:
    """(count, 3) unit vectors spread evenly over the cone of the allowed tilt, every fourth one straight.

    The angle goes with the root of a uniform number: equal areas of the (small) cap are equally likely.
    """
    tilt = _INSIDE * target.tilt * np.sqrt(rng.uniform(size=count)) * (np.arange(count) % 4 != 0)
    turn = rng.uniform(0, 2 * np.pi, count)
    sideways = np.cos(turn)[:, None] * target.axis_basis[:, 0] + np.sin(turn)[:, None] * target.axis_basis[:, 1]
    return np.asarray(np.cos(tilt)[:, None] * target.axis + np.sin(tilt)[:, None] * sideways)
