"""What is drawn of an arm and of what is asked of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.words import REGIONS

if TYPE_CHECKING:
    from posture_opt.collision.scene import Scene
    from posture_opt.selection.task_target import TaskTarget
    from posture_opt.uncertainty.spread import Spread
    from posture_opt.uncertainty.tool_point import ToolPoint

APART = 0.1  # mm: from there on the target is marked beside the tool point
ARROW = 0.3  # of the arm's extent
_SHOWN = 0.16  # of the arm's extent: the size at which an ellipse is well seen


@dataclass(frozen=True)
class Skeleton:
    """What is drawn of an arm, world frame [mm].

    Args:
        points: (k, 3) corners of the line through all frames, from the base to the tool.
        joints: (n, 3) where the joints act; ``prismatic`` which of them slide.
    """

    points: Array
    joints: Array
    prismatic: tuple[bool, ...]

    @classmethod
    def of(cls, tool_point: ToolPoint, q: Any) -> Skeleton:
        """The skeleton at the posture ``q`` (n,)."""
        robot = tool_point.robot
        reached, _ = tool_point.walk([float(v) for v in q])
        origins = np.array([screw.origin for screw in reached.screws] + [reached.position], dtype=float) * 1e3
        start = len(robot.base)  # the way from the world's origin to the base is no link
        moved = [k for k in range(start + 1, len(origins)) if np.linalg.norm(origins[k] - origins[k - 1]) > 1e-6]
        keep = [start, *moved]
        slides = tuple(joint.type == "prismatic" for joint in robot.joints)
        return cls(origins[keep], origins[list(robot.driven)], slides)

    @property
    def extent(self) -> float:
        """The largest edge of the box around the arm [mm]."""
        return max(float(np.ptp(self.points, axis=0).max()), 1.0)


def enlargement(size: float, extent: float) -> float:
    """The round factor (1, 2, 5, 10, 20, …) that brings ``size`` nearest below a sixth of ``extent``."""
    if size <= 0:
        return 1.0
    wanted = max(_SHOWN * extent / size, 1.0)
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(step * power for step in (1, 2, 5) if step * power <= wanted * (1 + 1e-9))


@dataclass(frozen=True)
class Aim:
    """What is asked of the tool point: the direction (3,) of the task, the target, the cell; None: not asked."""

    direction: Array | None
    target: TaskTarget | None = None
    scene: Scene | None = None


def region_label(spread: Spread, factor: float) -> str:
    """What the drawn region is, with the factor that it is enlarged by."""
    name = REGIONS[spread.ellipse.rank]
    return f"{name}, enlarged {factor:g}\N{MULTIPLICATION SIGN}" if factor > 1 else f"{name}, true to scale"
