"""A path: the spread along it, with the sources that it comes from, and the joints over it.

Both panels share the axis of the way along the path [mm].
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.numerics import Array, Codes
from posture_opt.report.page.colours import BLUE, GREEN, GREY, LIGHT, ORANGE, PURPLE, VERMILLION
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import label_of, styled
from posture_opt.statements.notation import joint_unit, length_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.selection.answer.solution import Solution

_MAX_SOURCES = 5  # sources that are drawn by themselves
_MIN_SHARE = 0.02  # of the variance, on the mean along the path: sources below are lumped
_MIN_CORNER_COSINE = math.cos(math.radians(20.0))  # of the angle at a point up to which it is no corner
_MAX_BUDGET_POINTS = 151  # points whose budget is drawn
_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, VERMILLION)
_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (6, 1, 1, 1)), (0, (2, 1)), (0, (8, 2)), (0, (1, 3)))
_LINE_LOOKS = tuple(zip((BLUE, ORANGE, GREEN, VERMILLION, PURPLE, GREY, "black"), _DASHES, strict=True))


@styled
def plot_path(found: Solution) -> Figure:
    """The largest standard deviation in the part that counts, divided by the sources' shares in its variance, and the
    joints, each as its change from the first point on.

    Above: areas are ``share · σ`` of the main sources, the black line is σ [µm or mm], a star its worst point; the
    dashed line is the lower bound that no motion gets below, so that its distance from the star is what could still be
    gained. Dotted lines are corners, where another direction counts from there on. Below: joints [deg or mm].
    """
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
    """The upper panel: standard deviation along the path, stacked by source."""
    sigma, way = found.motion.sigma, 1e3 * found.path.lengths
    unit, factor = length_unit(sigma.tolist())
    every = np.unique(np.linspace(0, len(sigma) - 1, min(_MAX_BUDGET_POINTS, len(sigma))).round().astype(int))
    names, shares = _shares(found, every)
    heights = factor * shares * sigma[every]
    colours = [*_COLOURS[: len(names) - 1], LIGHT] if names[-1] == "others" else list(_COLOURS[: len(names)])
    labels = [label_of(name) for name in names]
    axes.stackplot(way[every], heights, labels=labels, colors=colours, alpha=0.9, lw=0.8, edgecolor="white")
    axes.plot(way, factor * sigma, color="black", lw=1.4)
    for k, corner in enumerate(_corners(found)):
        label = None if k else "corner: another direction counts"
        axes.axvline(way[corner], color="black", lw=0.8, ls=":", zorder=3, label=label)
    axes.plot(*_listed(found, way, factor * sigma), "o", color="black", ms=3.5, ls="none", label="listed points")
    worst = found.worst_index
    star: dict[str, Any] = {"color": VERMILLION, "mec": "black", "ms": 13, "ls": "none", "clip_on": False}
    axes.plot(way[worst], factor * sigma[worst], "*", **star, label="worst")
    if found.bound > 0:
        axes.axhline(factor * found.bound, color=GREY, ls="--", lw=1.0, label="lower bound of the worst")
    axes.set_ylim(0.0, 1.12 * factor * float(sigma.max()))
    axes.set_ylabel(f"standard deviation across the path [{unit}]")


def _corners(found: Solution) -> list[int]:
    """The points at which the direction of travel turns at once, and with it what is across it: shares jump there."""
    along = np.diff(found.path.points, axis=0)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    turns = np.sum(along[:-1] * along[1:], axis=1) < _MIN_CORNER_COSINE
    return (np.flatnonzero(turns) + 1).tolist()


def _listed(found: Solution, way: Array, values: Array) -> tuple[Array, Array]:
    """Way and value (k,) of the points that the problem file lists; further ones were inserted between them."""
    return way[found.path.listed], values[found.path.listed]


def _shares(found: Solution, points: Codes) -> tuple[list[str], Array]:
    """Names of the main sources, and their shares (m, N) in the variance along the worst axis of some points.

    A source whose errors cancel others' has a share below zero somewhere and no meaning by itself: it is lumped, as
    are sources below 2 % of the variance on average. "others" is left out where it is below 0.1 % everywhere.

    Args:
        points: (N,) numbers of the points whose budget is drawn.
    """
    budgets = [{s.parameter: s.share for s in found.points[k].budget} for k in points.tolist()]
    every = {name: np.array([budget.get(name, 0.0) for budget in budgets]) for name in budgets[0]}
    own = {name: share for name, share in every.items() if share.mean() >= _MIN_SHARE and share.min() > -1e-3}
    main = sorted(own, key=lambda name: -float(own[name].mean()))[:_MAX_SOURCES]
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
