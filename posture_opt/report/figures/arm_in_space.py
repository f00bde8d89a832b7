"""An arm in space: solid where its shape is known, with the obstacles of its cell."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from posture_opt.numerics import Array
from posture_opt.report.figures.bodies import Bodies, label_obstacles, obstacles_near
from posture_opt.report.figures.skeleton import APART, ARROW, Aim, Skeleton, region_label
from posture_opt.report.style import BLUE, GREY, LIGHT, ORANGE, VERMILLION, legend_below, new_figure

if TYPE_CHECKING:
    from posture_opt.selection.task_target import TaskTarget
    from posture_opt.uncertainty.spread import Spread

_ROUND: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round"}
_HOLE = 0.12  # of the arrow: the radius of the ring about it
_ELEVATION = 18.0  # deg: a little from above


def enlarged_ellipsoid(spread: Spread, factor: float, n: int = 24) -> Array:
    """(3, n, 2n) surface of the 95 % region in space, enlarged about the mean, world [mm]."""
    ellipse = spread.ellipse
    k = factor * ellipse.factor(0.95)
    u, v = np.meshgrid(np.linspace(0, math.pi, n), np.linspace(0, 2 * math.pi, 2 * n), indexing="ij")
    sphere = np.array([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)])
    center = 1e3 * (spread.basis.T @ ellipse.center)
    shape = spread.basis.T @ (ellipse.axes * ellipse.semi_axes)
    surface: Array = center[:, None, None] + 1e3 * k * np.einsum("ij,jkl->ikl", shape, sphere)
    return surface


def draw_in_space(spread: Spread, aim: Aim, skeleton: Skeleton, factor: float) -> Figure:
    """The arm, the region about its tool point, the target and what stands around."""
    figure = new_figure(5.8)
    # What lies in front is decided here: sorted by depth, the region would hide the tool point at its centre.
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    surface = enlarged_ellipsoid(spread, factor)
    tool = 1e3 * spread.position
    seen = [skeleton.points, surface.reshape(3, -1).T]
    robot = spread.tool_point.robot
    solid = Bodies.of_arm(robot, spread.q) if robot.shape else None
    if solid is not None:
        seen.append(solid.faces.reshape(-1, 3))
    obstacles = {} if aim.scene is None else obstacles_near(aim.scene, np.vstack(seen))
    cell = Bodies.of_obstacles(obstacles)
    if cell is not None:
        seen.append(cell.faces.reshape(-1, 3))
    if aim.target is not None:
        seen += _space_target(axes, aim.target, tool)
    if aim.direction is not None:
        seen += _space_direction(axes, tool, ARROW * skeleton.extent * aim.direction)
    low, high = _box(np.vstack(seen))
    angles = _ELEVATION, _azimuth(skeleton)
    x, y, _ = skeleton.points.T
    axes.plot(x, y, low[2], color=LIGHT, lw=4, zorder=1, label="shadow on the floor")
    if solid is None:
        axes.plot(*skeleton.points.T, color=BLUE, lw=4.5, zorder=3, label="arm", **_ROUND)
        axes.plot(*skeleton.joints.T, "o", color="white", mec=BLUE, mew=1.8, ms=7, zorder=4, label="joints")
    else:
        solid.draw(axes, *angles, zorder=3)
        if any(factor.nominal for factor in robot.tool if factor.kind == "translate"):
            axes.plot(*skeleton.points[-2:].T, color=GREY, lw=2, zorder=4, **_ROUND)
        axes.plot([], [], "s", color=BLUE, alpha=0.8, ms=9, label="arm (capsules that contain it)")
    axes.plot_surface(*surface, color=ORANGE, alpha=0.5, linewidth=0, shade=True, zorder=5)
    axes.plot([], [], "s", color=ORANGE, alpha=0.7, ms=9, label=region_label(spread, factor))
    axes.plot(*tool[:, None], "o", color="black", ms=4.5, zorder=7, label="tool point")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    axes.set_box_aspect(tuple(high - low), zoom=0.97)
    axes.view_init(*angles)
    axes.locator_params(nbins=6)
    if cell is not None:
        cell.draw(axes, *angles, zorder=2)
        label_obstacles(axes, obstacles, np.vstack(seen[:3]))
    legend_below(figure)
    return figure


def _azimuth(skeleton: Skeleton) -> float:
    """From the side of the arm, a little from the front [deg]: its links do not hide each other."""
    reach = skeleton.points[:, :2] - skeleton.points[0, :2]
    out = reach[np.argmax(np.linalg.norm(reach, axis=1))]
    return math.degrees(math.atan2(out[1], out[0])) - 65


def _space_direction(axes: Any, tool: Array, step: Array) -> list[Array]:
    size = float(np.linalg.norm(step))
    side = np.cross(step, np.eye(3)[np.argmin(np.abs(step))])
    side *= _HOLE * size / float(np.linalg.norm(side))
    turn = np.linspace(0, 2 * math.pi, 60)[:, None]
    rim = tool + np.cos(turn) * side + np.sin(turn) * np.cross(step / size, side)
    axes.plot(*rim.T, color="black", lw=1.5, zorder=6)
    axes.quiver(*tool, *step, color="black", lw=2, arrow_length_ratio=0.22, zorder=6)
    axes.plot([], [], "-", color="black", lw=2, marker=">", label="direction of the task")
    return [(tool + step)[None]]


def _space_target(axes: Any, target: TaskTarget, tool: Array) -> list[Array]:
    seen = []
    if target.kind == "region":
        corners = 1e3 * np.array(list(itertools.product(*zip(target.lower, target.upper, strict=True))))
        edges = [(a, b) for a, b in itertools.combinations(corners, 2) if np.count_nonzero(np.abs(a - b) > 1e-9) == 1]
        for k, (a, b) in enumerate(edges):
            label = None if k else "box for the target"
            axes.plot(*np.array([a, b]).T, "--", color=GREY, lw=1, zorder=2, label=label)
        seen.append(corners)
    point = 1e3 * target.lower
    if target.kind == "point" and np.linalg.norm(point - tool) > APART:
        axes.plot(*point[:, None], "X", color=VERMILLION, mec="white", ms=11, zorder=8, label="target, not reached")
        seen.append(point[None])
    return seen


def _box(points: Array) -> tuple[Array, Array]:
    """Corners of a box about the points, no side shorter than half of the longest; drawn with equal scales."""
    low, high = points.min(axis=0), points.max(axis=0)
    longest = float((high - low).max())
    half = np.maximum(0.5 * (high - low) + 0.05 * longest, 0.25 * longest)
    middle = (low + high) / 2
    bottom, top = middle - half, middle + half
    lift = max(float(low[2] - 0.03 * longest - bottom[2]), 0.0)  # the floor is right under the arm
    bottom[2], top[2] = bottom[2] + lift, top[2] + lift
    return bottom, top
