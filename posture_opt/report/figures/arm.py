"""The arm in its posture, with the enlarged 95 % region of its tool point and the direction of the task."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from posture_opt.numerics import Array
from posture_opt.report.style import (
    BLUE,
    GREY,
    LIGHT,
    ORANGE,
    VERMILLION,
    legend_above,
    legend_below,
    new_figure,
    styled,
)
from posture_opt.report.words import REGIONS, line_words

if TYPE_CHECKING:
    from posture_opt.selection.solution import Solution
    from posture_opt.selection.task_target import TaskTarget
    from posture_opt.uncertainty.spread import Spread
    from posture_opt.uncertainty.tool_point import ToolPoint

_ROUND: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round"}
_APART = 0.1  # mm: from there on the target is marked beside the tool point
_ARROW = 0.3  # of the arm's extent
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


@styled
def plot_solution(solution: Solution) -> Figure:
    """The arm in the best posture, the 95 % region enlarged by a stated factor, direction and target."""
    return _draw(solution.spread, _Aim(solution.target.direction, solution.target))


@styled
def plot_spread(spread: Spread) -> Figure:
    """The arm at a posture with the 95 % region enlarged by a stated factor, and the direction of the task."""
    return _draw(spread, _Aim(None if spread.for_task is None else spread.for_task.direction))


@dataclass(frozen=True)
class _Aim:
    """What is asked of the tool point: the direction (3,) of the task, and the target; None: not asked."""

    direction: Array | None
    target: TaskTarget | None = None


def _draw(spread: Spread, aim: _Aim) -> Figure:
    skeleton = Skeleton.of(spread.tool_point, spread.q)
    factor = enlargement(1e3 * float(spread.region(0.95)[-1]), skeleton.extent)
    return (_plane if len(spread.basis) == 2 else _space)(spread, aim, skeleton, factor)


def region_label(spread: Spread, factor: float) -> str:
    """What the drawn region is, with the factor that it is enlarged by."""
    name = REGIONS[spread.ellipse.rank]
    return f"{name}, enlarged {factor:g}\N{MULTIPLICATION SIGN}" if factor > 1 else f"{name}, true to scale"


def enlarged_ellipse(spread: Spread, factor: float) -> Array:
    """(121, 2) boundary of the 95 % ellipse of a planar arm, enlarged about the mean, in the arm's plane [mm]."""
    ellipse = spread.ellipse
    boundary: Array = 1e3 * (ellipse.center + factor * (ellipse.points(0.95) - ellipse.center))
    return boundary


def _plane(spread: Spread, aim: _Aim, skeleton: Skeleton, factor: float) -> Figure:
    B = spread.basis
    line, joints = skeleton.points @ B.T, skeleton.joints @ B.T
    boundary = enlarged_ellipse(spread, factor)
    figure = new_figure(6.4, 5.6)
    axes = figure.add_subplot()
    label = region_label(spread, factor)
    axes.fill(*boundary.T, facecolor=ORANGE, alpha=0.35, zorder=2)
    axes.fill(*boundary.T, facecolor="none", edgecolor=VERMILLION, lw=1.8, zorder=5, label=label)
    axes.plot(*line.T, color=BLUE, lw=5, zorder=3, label="arm", **_ROUND)
    axes.plot(*joints.T, "o", color="white", mec=BLUE, mew=2, ms=9, zorder=4, label="joints")
    tool = 1e3 * (B @ spread.position)
    axes.plot(*tool, "o", color="black", ms=5, zorder=6, label="tool point")
    seen = [line, boundary]
    if aim.target is not None:
        seen += _plane_target(axes, aim.target, B, tool)
    if aim.direction is not None:
        seen += _plane_direction(axes, B @ aim.direction, tool, skeleton.extent)
    _limits(axes, np.vstack(seen))
    axes.set(xlabel=f"{line_words(B[0])} [mm]", ylabel=f"{line_words(B[1])} [mm]", aspect="equal")
    legend_below(axes, 3)
    return figure


def _plane_target(axes: Any, target: TaskTarget, B: Array, tool: Array) -> list[Array]:
    """Draws region and point; the points that must be seen."""
    seen = []
    if target.kind == "region":
        low, high = 1e3 * B @ target.lower, 1e3 * B @ target.upper
        corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
        axes.plot(*corners.T, "--", color=GREY, lw=1.2, zorder=1, label="box for the target")
        seen.append(corners)
    point = 1e3 * B @ target.lower
    if target.kind == "point" and np.linalg.norm(point - tool) > _APART:
        axes.plot(*point, "X", color=VERMILLION, mec="white", ms=11, zorder=6, label="target, not reached")
        seen.append(point[None])
    return seen


def _plane_direction(axes: Any, along: Array, tool: Array, extent: float) -> list[Array]:
    """Draws the direction (2,), where it is not that of the view; the point that must be seen."""
    if np.linalg.norm(along) < 1e-6:
        return []
    end = tool + _ARROW * extent * along
    arrow = {"arrowstyle": "-|>", "color": "black", "lw": 2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, tool, arrowprops=arrow, zorder=7)
    axes.plot([], [], "-", color="black", lw=2, marker=">", label="direction of the task")
    return [end[None]]


def _limits(axes: Any, points: Array) -> None:
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.08 * max(float((high - low).max()), 1.0)
    # As high as it must be for its width: no white bands above and below an arm that lies flat.
    width, height = high - low + 2 * margin
    axes.figure.set_size_inches(6.4, min(max(5.4 * height / width + 1.2, 3.2), 8.0))
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)


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


def _space(spread: Spread, aim: _Aim, skeleton: Skeleton, factor: float) -> Figure:
    figure = new_figure(6.8, 5.8)
    # What lies in front is decided here: sorted by depth, the region would hide the tool point at its centre.
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    surface = enlarged_ellipsoid(spread, factor)
    seen = [skeleton.points, surface.reshape(3, -1).T]
    tool = 1e3 * spread.position
    if aim.target is not None:
        seen += _space_target(axes, aim.target, tool)
    if aim.direction is not None:
        seen += _space_direction(axes, tool, _ARROW * skeleton.extent * aim.direction)
    low, high = _box(np.vstack(seen))
    x, y, _ = skeleton.points.T
    axes.plot(x, y, low[2], color=LIGHT, lw=4, zorder=1, label="shadow on the floor")
    axes.plot(*skeleton.points.T, color=BLUE, lw=4.5, zorder=3, label="arm", **_ROUND)
    axes.plot(*skeleton.joints.T, "o", color="white", mec=BLUE, mew=1.8, ms=7, zorder=4, label="joints")
    axes.plot_surface(*surface, color=ORANGE, alpha=0.5, linewidth=0, shade=True, zorder=5)
    axes.plot([], [], "s", color=ORANGE, alpha=0.7, ms=9, label=region_label(spread, factor))
    axes.plot(*tool[:, None], "o", color="black", ms=4.5, zorder=7, label="tool point")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    axes.set_box_aspect(tuple(high - low), zoom=0.98)
    _look(axes, skeleton)
    legend_above(axes, 3)
    return figure


def _look(axes: Any, skeleton: Skeleton) -> None:
    """From the side of the arm, a little from the front and above: its links do not hide each other."""
    reach = skeleton.points[:, :2] - skeleton.points[0, :2]
    out = reach[np.argmax(np.linalg.norm(reach, axis=1))]
    axes.view_init(elev=18, azim=math.degrees(math.atan2(out[1], out[0])) - 65)
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=6)


def _space_direction(axes: Any, tool: Array, step: Array) -> list[Array]:
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
    if target.kind == "point" and np.linalg.norm(point - tool) > _APART:
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
