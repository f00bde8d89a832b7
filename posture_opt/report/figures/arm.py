"""The arm in its posture, with the enlarged 95 % region of its tool point, the direction of the task, and its cell.

A planar arm is seen along the normal of its plane, others from the side that shows most.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.page.style import styled
from posture_opt.report.scene.arm_figure import draw_arm
from posture_opt.report.scene.arm_geometry import ArmGeometry
from posture_opt.report.scene.arm_solids import ArmSolids, Solid
from posture_opt.statements.notation import joint_unit
from posture_opt.units import fixed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posture_opt.selection.answer.solution import Solution
    from posture_opt.uncertainty.spread.spread import Spread

_MAX_GHOSTS = 4  # further postures of a motion


@styled
def plot_solution(solution: Solution) -> Figure:
    """The arm in the best posture, the 95 % region enlarged by a stated factor, direction and target.

    Region and hole have one scale, and the arm another: a region of some micrometres would be no point of the picture.
    """
    return _draw(solution.spread, ArmGeometry.of_solution(solution))


@styled
def plot_spread(spread: Spread) -> Figure:
    """The arm at a posture with the 95 % region enlarged by a stated factor, and the direction of the task."""
    return _draw(spread, ArmGeometry.of_spread(spread))


@styled
def plot_motion(found: Solution) -> Figure:
    """The arm at the worst point of a path as of a solution, faintly at others along it, and the path."""
    geometry = ArmGeometry.of_solution(found.worst)
    arm, Q = ArmSolids(found.worst.spread.tool_point.robot), found.motion.Q
    others = np.unique(np.linspace(0, len(Q) - 1, _MAX_GHOSTS).round().astype(int)).tolist()
    ghosts = [
        solid.placed(frames)
        for frames in (arm.frames(Q[k]) for k in others if k != found.worst_index)
        for solid in arm.solids
        if solid.role not in ("base",)
    ]
    return _draw(found.worst.spread, geometry, ghosts, found.path.points)


def _draw(spread: Spread, geometry: ArmGeometry, ghosts: Sequence[Solid] = (), way: Array | None = None) -> Figure:
    """The arm with the values of its joints.

    Args:
        ghosts: further postures, drawn faintly.
        way: (k, 3) path of the tool point [m].
    """
    robot = spread.tool_point.robot
    units = [joint_unit(joint.type) for joint in robot.joints]
    values = zip(robot.joint_names, spread.q, units, strict=True)
    posture = [(name, f"{fixed(factor * value, 1)} {unit}") for name, value, (unit, factor) in values]
    return draw_arm(geometry, robot.name, posture, ghosts, way)
