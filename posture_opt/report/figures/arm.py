"""The arm in its posture, with the enlarged 95 % region of its tool point and the direction of the task."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from posture_opt.numerics import Array
from posture_opt.report.figures.arm_in_space import draw_in_space
from posture_opt.report.figures.skeleton import APART, ARROW, Aim, Skeleton, enlargement, region_label
from posture_opt.report.style import (
    BLUE,
    GREY,
    ORANGE,
    VERMILLION,
    WIDTH,
    legend_below,
    new_figure,
    styled,
)
from posture_opt.report.words import line_words

if TYPE_CHECKING:
    from posture_opt.selection.solution import Solution
    from posture_opt.selection.task_target import TaskTarget
    from posture_opt.uncertainty.spread import Spread

_ROUND: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round"}


@styled
def plot_solution(solution: Solution) -> Figure:
    """The arm in the best posture, the 95 % region enlarged by a stated factor, direction and target."""
    return _draw(solution.spread, Aim(solution.target.direction, solution.target, solution.problem.scene))


@styled
def plot_spread(spread: Spread) -> Figure:
    """The arm at a posture with the 95 % region enlarged by a stated factor, and the direction of the task."""
    direction = None if spread.for_task is None else spread.for_task.direction
    return _draw(spread, Aim(direction, scene=getattr(spread.problem, "scene", None)))


def _draw(spread: Spread, aim: Aim) -> Figure:
    skeleton = Skeleton.of(spread.tool_point, spread.q)
    factor = enlargement(1e3 * float(spread.region(0.95)[-1]), skeleton.extent)
    return (_plane if len(spread.basis) == 2 else draw_in_space)(spread, aim, skeleton, factor)


def enlarged_ellipse(spread: Spread, factor: float) -> Array:
    """(121, 2) boundary of the 95 % ellipse of a planar arm, enlarged about the mean, in the arm's plane [mm]."""
    ellipse = spread.ellipse
    boundary: Array = 1e3 * (ellipse.center + factor * (ellipse.points(0.95) - ellipse.center))
    return boundary


def _plane(spread: Spread, aim: Aim, skeleton: Skeleton, factor: float) -> Figure:
    B = spread.basis
    line, joints = skeleton.points @ B.T, skeleton.joints @ B.T
    boundary = enlarged_ellipse(spread, factor)
    figure = new_figure(5.0)
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
    legend_below(figure)
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
    if target.kind == "point" and np.linalg.norm(point - tool) > APART:
        axes.plot(*point, "X", color=VERMILLION, mec="white", ms=11, zorder=6, label="target, not reached")
        seen.append(point[None])
    return seen


def _plane_direction(axes: Any, along: Array, tool: Array, extent: float) -> list[Array]:
    """Draws the direction (2,), where it is not that of the view; the point that must be seen."""
    if np.linalg.norm(along) < 1e-6:
        return []
    end = tool + ARROW * extent * along
    arrow = {"arrowstyle": "-|>", "color": "black", "lw": 2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, tool, arrowprops=arrow, zorder=7)
    axes.plot([], [], "-", color="black", lw=2, marker=">", label="direction of the task")
    return [end[None]]


def _limits(axes: Any, points: Array) -> None:
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.08 * max(float((high - low).max()), 1.0)
    # As high as it must be for its width: no white bands above and below an arm that lies flat.
    width, height = high - low + 2 * margin
    axes.figure.set_size_inches(WIDTH, min(max((WIDTH - 1.0) * height / width + 1.0, 3.0), 6.0))
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
