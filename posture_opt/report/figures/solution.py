"""The error budget of a posture, and the standard deviation over two joints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.figures.axis_names import critical_axis, with_letter
from posture_opt.report.page.colours import BLUE, COLOUR_MAP, GREY, LIGHT, ORANGE, VERMILLION
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import legend_beside, styled
from posture_opt.report.parts.budget_parts import main_groups, named, others_words
from posture_opt.report.text.words import PARTS
from posture_opt.statements.notation import joint_unit, length_unit, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.robot.robot import Joint
    from posture_opt.selection.answer.solution import Solution
    from posture_opt.uncertainty.spread.budget_groups import ShareGroup
    from posture_opt.uncertainty.spread.spread import Spread
    from posture_opt.uncertainty.spread.task_spread import TaskSpread

_GRID_VALUES = 181


def plot_task_budget(spread: Spread, seen: TaskSpread) -> Figure:
    """The budget of the axis that counts most for a task."""
    return plot_budget(spread, seen.budget_groups, critical_axis(seen.critical))


def plot_longest_axis_budget(spread: Spread) -> Figure:
    """The budget of the longest axis of the scatter."""
    longest = with_letter("along the longest axis of the scatter", spread.axes[-1])
    return plot_budget(spread, spread.budget_groups, longest)


@styled
def plot_budget(spread: Spread, groups: Sequence[ShareGroup], along: str) -> Figure:
    """Share of every source in the variance ``along`` some axis [%], the largest on top, the small ones lumped.

    Correlated sources share one bar: their shares add up to it, and each alone may be negative. Halving the source of
    a share s leaves ``sqrt(1 − 3 s/4)`` of the standard deviation.

    Args:
        groups: sources with their shares, those that correlate in one group.
        along: which axis it is, in words.
    """
    shown, rest = main_groups(groups)
    names = [named(group.parameters) for group in shown]
    values = [group.share for group in shown]
    if rest:
        names.append(others_words(rest))
        values.append(sum(s.share for s in rest))
    figure = new_figure(0.75 + 0.28 * len(names))
    axes = figure.add_subplot()
    colours = [BLUE] * len(shown) + [LIGHT] * bool(rest)
    axes.barh(range(len(names)), [100 * v for v in values], color=colours, height=0.68)
    for k, value in enumerate(values):
        end = (100 * max(value, 0.0), k)
        axes.annotate(percent(value), end, xytext=(4, 0), textcoords="offset points", va="center")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlim(min(0.0, 110 * min(values)), 113 * (max(values) or 1.0))
    axes.set_xlabel(f"share of the variance {along} [%]")
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    return figure


@styled
def plot_joint_map(solution: Solution) -> Figure:
    """Largest standard deviation of the part that counts over both joint values; answer and optima marked.

    Of arms with two joints. Where the target is in a box, a line encloses the postures that reach it. Colours [µm or
    mm] do not know the target: the answer is the best of the postures that reach it, not of the figure.
    """
    from matplotlib.ticker import MaxNLocator

    joints = solution.optimisation_problem.robot.joints
    assert len(joints) == 2, "a map has two axes"
    units = [joint_unit(joint.type) for joint in joints]
    factors = [factor for _, factor in units]
    grid = [_values(joint) for joint in joints]
    sigma, position = _evaluate(solution, *np.meshgrid(*grid, indexing="ij"))
    unit, scale = length_unit([float(sigma.max())])
    figure = new_figure(5.2)
    axes = figure.add_subplot()
    shown = [g * f for g, f in zip(grid, factors, strict=True)]
    mesh = axes.contourf(*shown, scale * sigma.T, levels=20, cmap=COLOUR_MAP)
    mesh.set_rasterized(True)  # as paths, hairlines show between the bands
    axes.contour(*shown, scale * sigma.T, levels=list(mesh.levels)[::2], colors="white", linewidths=0.6, alpha=0.6)
    _mark(axes, solution, shown, position, factors)
    bar = figure.colorbar(mesh, ax=axes, shrink=0.9, ticks=MaxNLocator(7))
    bar.set_label(f"standard deviation {PARTS[solution.critical.within]} [{unit}]")
    bar.outline.set_visible(False)
    names = [f"{joint.name} [{written}]" for joint, (written, _) in zip(joints, units, strict=True)]
    axes.set(xlabel=names[0], ylabel=names[1])
    axes.grid(visible=False)
    _ticks(axes, joints, shown)
    legend_beside(figure)
    return figure


def _values(joint: Joint) -> Array:
    """(181,) values over the range of a joint [rad or m]; more than a turn repeats itself, so one about zero does."""
    if joint.type == "revolute" and joint.lower <= -math.pi and joint.upper >= math.pi:
        return np.linspace(-math.pi, math.pi, _GRID_VALUES)
    return np.linspace(joint.lower, joint.upper, _GRID_VALUES)


def _evaluate(solution: Solution, q1: Array, q2: Array) -> tuple[Array, Array]:
    """Largest standard deviation (N, N) [m] and tool points (N, N, 3) [m, world frame] over the grid.

    ``sqrt(λ_max(Bᵀ C B))`` with the basis B (3, m) of the part that counts.

    Args:
        q1: (N, N) values of the first joint [rad or m]; ``q2`` (N, N) of the second.
    """
    moments = solution.optimisation_problem.tool_point.moments([q1.ravel(), q2.ravel()])
    B = solution.basis
    largest = np.linalg.eigvalsh(B.T @ moments.covariance @ B)[..., -1]
    sigma = np.sqrt(np.maximum(largest, 0.0)).reshape(q1.shape)
    return sigma, np.broadcast_to(moments.position, (q1.size, 3)).reshape(*q1.shape, 3)


def _mark(axes: Axes, solution: Solution, shown: list[Array], position: Array, factors: list[float]) -> None:
    """The answer, other optima, and the edge of the postures that reach a region.

    Args:
        shown: (N,) values of both joints in the units of the axes; ``factors`` from SI to them.
        position: (N, N, 3) tool points [m, world frame] over the grid.
    """
    target = solution.target
    if target.kind == "region":
        B = solution.optimisation_problem.reach.directions
        low, high = B.T @ target.lower, B.T @ target.upper
        at = position @ B
        inside = np.minimum(at - np.minimum(low, high), np.maximum(low, high) - at).min(axis=-1)
        axes.contour(*shown, inside.T, levels=[0.0], colors=VERMILLION, linewidths=1.8)
        axes.plot([], [], color=VERMILLION, label="edge of the postures in the box")
    optima = [
        [a.posture[j.name] for j in solution.optimisation_problem.robot.joints] for a in solution.alternatives[1:]
    ]
    if optima:
        points = np.array(optima) * factors
        label = "other postures at the target" if target.kind == "point" else "other optima"
        axes.plot(*points.T, "o", color="white", mec="black", ms=8, clip_on=False, zorder=5, label=label, ls="none")
    best = np.array(solution.q) * factors
    axes.plot(*best[:, None], "*", color=ORANGE, mec="black", ms=17, clip_on=False, zorder=6, label="answer", ls="none")
    axes.spines[:].set_color(GREY)


def _ticks(axes: Axes, joints: Sequence[Joint], shown: list[Array]) -> None:
    """Whole turns are divided by 45 or 60 degrees."""
    from matplotlib.ticker import MultipleLocator

    for axis, joint, values in zip((axes.xaxis, axes.yaxis), joints, shown, strict=True):
        turn = float(np.ptp(values))
        if joint.type == "revolute" and 170 <= turn <= 400:
            axis.set_major_locator(MultipleLocator(45 if turn <= 190 else 60))
