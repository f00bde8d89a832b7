"""What an ordinary posture is: away from the limits of its joints, its front to the tool.

It is a rule in two requirements, ``limit_margin`` and ``facing``; a term of the same kind that the task states replaces
it. The margin narrows the ranges of the joints, which the search draws its starts from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.search.inverse_kinematics import ROW_TOLERANCE
from posture_opt.selection.tasks import Task
from posture_opt.selection.terms.facing import Facing, front_cosine, has_front

_MARGIN = math.radians(5.0)  # room to approach, retract and touch up from there
_RANGE_SHARE = 0.1  # of a short range that either margin takes at most


@dataclass(frozen=True)
class OrdinaryRule:
    """The ranges of the joints (n,) [rad or m] that ordinary postures are in, and the terms that they meet besides."""

    lower: Array
    upper: Array
    terms: tuple[Facing, ...]

    @classmethod
    def of(cls, task: Task, robot: Robot) -> OrdinaryRule:
        """The rule for a task; everything is ordinary of an arm of two joints, as drawn on paper."""
        stated, spatial = {term.kind for term in task.subject_to}, robot.n > 2
        lower, upper = np.array(robot.lower), np.array(robot.upper)
        turns = np.array([joint.type == "revolute" for joint in robot.joints])
        margin = np.where(turns, np.minimum(_MARGIN, _RANGE_SHARE * (upper - lower)), 0.0)
        margin *= spatial and "limit_margin" not in stated
        faces = spatial and "facing" not in stated and has_front(robot)
        return cls(lower + margin, upper - margin, (Facing(kind="facing"),) * faces)

    def met(self, arm: Arm, q: Array) -> bool:
        """Whether a posture (n,) [rad or m] is ordinary."""
        if np.any((q < self.lower - ROW_TOLERANCE) | (q > self.upper + ROW_TOLERANCE)):
            return False
        return all(front_cosine(arm.robot, arm.walk(q), q[0]) >= t.bounds()[0] - ROW_TOLERANCE for t in self.terms)

    def narrowed(self, arm: Arm) -> Arm:
        """The arm whose joints have the ranges of the rule as limits."""
        ranges = zip(arm.robot.joints, self.lower.tolist(), self.upper.tolist(), strict=True)
        joints = tuple(replace(joint, lower=low, upper=high) for joint, low, high in ranges)
        return replace(arm, robot=replace(arm.robot, joints=joints))


def costs_at_most(share: float, objective: float, best: float) -> bool:
    """Whether an objective is within a share of the best one, as standard deviations: variances go by their square."""
    return objective <= best + ((1.0 + share) ** 2 - 1.0) * abs(best)
