"""Figures of a solution: the error budget, the spread over two joints, and spread and joints along a path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.numerics import Array, Codes
from posture_opt.report.figures.cloud import critical_axis, with_letter
from posture_opt.report.page.colours import BLUE, COLOUR_MAP, GREEN, GREY, LIGHT, ORANGE, PURPLE, VERMILLION
from posture_opt.report.page.style import label_of, legend, name_rows, new_axes, new_figure, styled
from posture_opt.report.parts.task_parts import main_groups, named, others_words
from posture_opt.report.text.words import PARTS
from posture_opt.statements.notation import joint_unit, length_unit, percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt import Solution, Spread
    from posture_opt.uncertainty.budget import ShareGroup
    from posture_opt.uncertainty.task_spread import TaskSpread

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
    Correlated sources share one bar: their shares add up to it, and each alone may be negative. Halving the source of a
    share s leaves ``sqrt(1 − 3 s/4)`` of the standard deviation."""
    shown, rest = main_groups(groups)
    names = [named(group.parameters) for group in shown]
    values = [group.share for group in shown]
    if rest:
        names.append(others_words(rest))
        values.append(sum(s.share for s in rest))
    figure, axes = new_axes(0.75 + 0.28 * len(names))
    colours = [BLUE] * len(shown) + [LIGHT] * bool(rest)
    axes.barh(range(len(names)), [100 * v for v in values], color=colours, height=0.68)
    for k, value in enumerate(values):
        end = (100 * max(value, 0.0), k)
        axes.annotate(percent(value), end, xytext=(4, 0), textcoords="offset points", va="center")
    name_rows(axes, dict(enumerate(names)))
    axes.invert_yaxis()
    axes.set_xlim(min(0.0, 110 * min(values)), 113 * (max(values) or 1.0))
    axes.set_xlabel(f"share of the variance {along} [%]")
    return figure


@styled
def plot_joint_map(solution: Solution) -> Figure:
    """Largest standard deviation of the part that counts over both joint values; answer and optima marked. Of arms with
    two joints. Where the target is in a box, a line encloses the postures that reach it."""
    from matplotlib.ticker import MaxNLocator, MultipleLocator

    joints = solution.optimisation_problem.robot.joints
    assert len(joints) == 2, "a map has two axes"
    units = [joint_unit(joint.type) for joint in joints]
    factors = [factor for _, factor in units]
    # More than a turn repeats itself, so one about zero does.
    turns = [joint.type == "revolute" and joint.lower <= -math.pi and joint.upper >= math.pi for joint in joints]
    ends = [(-math.pi, math.pi) if turn else (j.lower, j.upper) for turn, j in zip(turns, joints, strict=True)]
    grid = [np.linspace(*end, _GRID_VALUES) for end in ends]
    q1, q2 = np.meshgrid(*grid, indexing="ij")
    moments = solution.optimisation_problem.tool_point.moments([q1.ravel(), q2.ravel()])
    # (N, N) the largest standard deviation ``sqrt(λ_max(Bᵀ C B))`` [m] in the basis B (3, m) of the part that counts.
    largest = np.linalg.eigvalsh(solution.basis.T @ moments.covariance @ solution.basis)[..., -1]
    sigma = np.sqrt(np.maximum(largest, 0.0)).reshape(q1.shape)
    position = np.broadcast_to(moments.position, (q1.size, 3)).reshape(*q1.shape, 3)
    unit, scale = length_unit([float(sigma.max())])
    figure, axes = new_axes(5.2)
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
    for axis, joint, values in zip((axes.xaxis, axes.yaxis), joints, shown, strict=True):
        turn = float(np.ptp(values))
        if joint.type == "revolute" and 170 <= turn <= 400:  # whole turns are divided by 45 or 60 degrees
            axis.set_major_locator(MultipleLocator(45 if turn <= 190 else 60))
    legend(figure, beside=True)
    return figure


def _mark(axes: Axes, solution: Solution, shown: list[Array], position: Array, factors: list[float]) -> None:
    """The answer, other optima, and the edge of the postures that reach a region; ``shown`` (N,), ``position`` (N, N,
    3) [m, world frame]."""
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


_MIN_CORNER_COSINE = math.cos(math.radians(20.0))  # of the angle at a point up to which it is no corner
_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, VERMILLION)
_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (6, 1, 1, 1)), (0, (2, 1)), (0, (8, 2)), (0, (1, 3)))
_LINE_LOOKS = tuple(zip((BLUE, ORANGE, GREEN, VERMILLION, PURPLE, GREY, "black"), _DASHES, strict=True))


@styled
def plot_path(found: Solution) -> Figure:
    """The largest standard deviation in the part that counts, divided by the sources' shares in its variance, and the
    joints, each as its change from the first point on. Above: areas are ``share · σ`` of the main sources, the black
    line is σ [µm or mm], a star its worst point; the dashed line is the lower bound that no motion gets below, so that
    its distance from the star is what could still be gained. Dotted lines are corners, where another direction counts
    from there on."""
    figure = new_figure(5.8)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    _spread(above, found)
    _joints(below, found)
    below.set_xlabel("way along the path [mm]")
    below.set_xlim(0.0, 1e3 * float(found.path.lengths[-1]))
    for axes in (above, below):
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _spread(axes: Axes, found: Solution) -> None:
    sigma, way = found.motion.sigma, 1e3 * found.path.lengths
    unit, factor = length_unit(sigma.tolist())
    every = np.unique(np.linspace(0, len(sigma) - 1, min(151, len(sigma))).round().astype(int))
    names, shares = _shares(found, every)
    heights = factor * shares * sigma[every]
    colours = [*_COLOURS[: len(names) - 1], LIGHT] if names[-1] == "others" else list(_COLOURS[: len(names)])
    labels = [label_of(name) for name in names]
    axes.stackplot(way[every], heights, labels=labels, colors=colours, alpha=0.9, lw=0.8, edgecolor="white")
    axes.plot(way, factor * sigma, color="black", lw=1.4)
    along = np.diff(found.path.points, axis=0)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    # Where the direction of travel turns at once, and with it what is across it, shares jump.
    corners = np.flatnonzero(np.sum(along[:-1] * along[1:], axis=1) < _MIN_CORNER_COSINE) + 1
    for k, corner in enumerate(corners.tolist()):
        label = None if k else "corner: another direction counts"
        axes.axvline(way[corner], color="black", lw=0.8, ls=":", zorder=3, label=label)
    listed = found.path.listed
    axes.plot(way[listed], factor * sigma[listed], "o", color="black", ms=3.5, ls="none", label="listed points")
    worst = found.worst_index
    star: dict[str, Any] = {"color": VERMILLION, "mec": "black", "ms": 13, "ls": "none", "clip_on": False}
    axes.plot(way[worst], factor * sigma[worst], "*", **star, label="worst")
    if found.bound > 0:
        axes.axhline(factor * found.bound, color=GREY, ls="--", lw=1.0, label="lower bound of the worst")
    axes.set_ylim(0.0, 1.12 * factor * float(sigma.max()))
    axes.set_ylabel(f"standard deviation across the path [{unit}]")


def _shares(found: Solution, points: Codes) -> tuple[list[str], Array]:
    """Names of the main sources, and their shares (m, N) in the variance along the worst axis of some points;
    ``points`` (N,)."""
    budgets = [{s.parameter: s.share for s in found.points[k].budget} for k in points.tolist()]
    every = {name: np.array([budget.get(name, 0.0) for budget in budgets]) for name in budgets[0]}
    # Sources below 2 % of the variance, on the mean along the path, are lumped.
    own = {name: share for name, share in every.items() if share.mean() >= 0.02 and share.min() > -1e-3}
    main = sorted(own, key=lambda name: -float(own[name].mean()))[:5]
    shares = [np.maximum(every[name], 0.0) for name in main]
    left = 1.0 - np.sum(shares, axis=0) if shares else np.ones(len(points))
    if float(np.max(left)) < 1e-3:
        return main, np.array(shares)
    return [*main, "others"], np.array([*shares, np.maximum(left, 0.0)])


def _joints(axes: Axes, found: Solution) -> None:
    """The lower panel: each joint less its value at the first point [deg or mm]; a steep line is a fast joint."""
    way, Q = 1e3 * found.path.lengths, found.motion.Q
    for k, (joint, (colour, dashes)) in enumerate(
        zip(found.optimisation_problem.robot.joints, _LINE_LOOKS * 3, strict=False)
    ):
        unit, factor = joint_unit(joint.type)
        axes.plot(
            way, factor * (Q[:, k] - Q[0, k]), color=colour, label=label_of(f"{joint.name} [{unit}]"), lw=1.6, ls=dashes
        )
    axes.set_ylabel("joints, from the first point")
