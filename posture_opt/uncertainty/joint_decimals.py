"""How many decimals of joint values are worth writing: rounding is to be small beside the scatter of the tool point."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.uncertainty.sources import Sources
from posture_opt.uncertainty.tool_point import ToolPoint

SHARE = 0.01
"""Of the scatter: by how much rounding may move the tool point, all joints rounded to the worse side."""
UNSTATED = 1e-4
"""m: the scatter that counts where none is stated; rounding then moves the tool point by less than 1 µm."""
_FLATTEST = 0.1  # of the longest axis: a shorter one counts as so long, for a flat ellipse has one of length zero
_MOST = 9  # decimals of a degree: 0.01 µm at 1 km


class HasScatter(Protocol):
    """Anything that names an arm and its sources of error, such as a ``Problem``."""

    @property
    def arm(self) -> Arm: ...
    @property
    def sources(self) -> Sources: ...


def joint_decimals(problem: HasScatter, postures: Array, *, unit: str = "deg") -> int:
    """The decimals of joint values such that rounding them moves the tool point by less than `SHARE` of its scatter.

    With the columns ``J_j`` of the Jacobian and a last decimal h, rounding moves the tool point by at most
    ``Σ_j |J_j| h / 2``. The scatter is the shortest half-axis of the ellipsoid of one standard deviation, or a tenth of
    the longest where that is more.

    Args:
        problem: names ``arm`` and ``sources``.
        postures: (N, n) [rad or m]; the decimals serve for all of them.
        unit: of revolute joints, ``deg`` or ``rad``; prismatic ones are written in mm, or in m beside rad.
    """
    rows = np.atleast_2d(np.asarray(postures, dtype=float))
    turn, slide = (math.radians(1.0), 1e-3) if unit == "deg" else (1.0, 1.0)
    steps = np.array([turn if joint.type == "revolute" else slide for joint in problem.arm.robot.joints])
    moves = [float(np.linalg.norm(np.asarray(problem.arm.jacobian(q))[:3], axis=0) @ steps) / 2 for q in rows]
    allowed = [SHARE * scatter(problem, q) for q in rows]
    ratio = min(a / m for a, m in zip(allowed, moves, strict=True) if m > 0) if any(moves) else 1.0
    # Strictly less than the share: an exact power of ten takes one decimal more.
    return int(min(max(math.floor(-math.log10(ratio)) + 1, 0), _MOST))


def scatter(problem: HasScatter, q: Array) -> float:
    """The standard deviation of the tool point that rounding is compared with at a posture (n,) [m]."""
    tool_point = ToolPoint.of(problem.arm, problem.sources)
    reached, _ = tool_point.walk(list(map(float, q)))
    first = np.asarray(tool_point.pose_first_order(list(map(float, q)), reached), dtype=float)[:3, :3]
    axes = np.sqrt(np.clip(np.linalg.eigvalsh(first), 0, None))
    return float(max(axes[0], _FLATTEST * axes[-1])) or UNSTATED
