"""What to measure next: where the tool point goes, and what that says of each parameter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.measurements.measurements import nominal_poses
from posture_opt.numerics import Array
from posture_opt.report.figures.cloud import decimals
from posture_opt.report.page.colours import BLUE, GREY, LIGHT, LIMIT_COLOUR, ORANGE
from posture_opt.report.page.style import Look, legend, new_figure, styled
from posture_opt.units import ERROR_UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.experiments.measurement_plan import MeasurementPlan

_PARAMETER_TITLES = {
    "parameters": "Each parameter by itself",
    "task": "Each parameter by itself: the plan serves the task, not these",
    "recheck": "Each parameter by itself, with a change of it",
}


@styled
def plot_plan_points(plan: MeasurementPlan) -> Figure:
    """The planned tool points [mm], the given ones and the task's, over those of random allowed postures, from each
    side. Plans go to the edge of what is allowed: there a small error of an angle moves the tool point most. One view
    for an arm that moves in a plane, else from above and from the side; the dashed line is the height that links keep
    above."""
    moving = [k for k in range(3) if np.ptp(plan.reach[:, k]) > 1e-6]
    pairs = [(0, 1), (0, 2)] if len(moving) == 3 else [(moving[0], moving[-1])]
    figure = new_figure(4.6)
    for number, pair in enumerate(pairs, start=1):
        axes = figure.add_subplot(1, len(pairs), number)
        at = list(pair)
        label = "random postures that keep clear"
        dots: Look = {"color": "#BDBDBD", "ms": 4, "mew": 0, "rasterized": True, "zorder": 1}
        axes.plot(*(1e3 * plan.reach[:, at]).T, ".", label=label, **dots)
        if plan.given is not None:
            points, _ = nominal_poses(plan.robot, plan.given.q)
            axes.plot(*(1e3 * points[:, at]).T, "x", color=GREY, ms=5, mew=1.2, zorder=2, label="measured already")
        axes.plot(*(1e3 * plan.points[:, at]).T, "o", color=BLUE, mec="white", ms=8, zorder=3, label="to be measured")
        if plan.target is not None:
            point, _ = nominal_poses(plan.robot, plan.target.q[None])
            star: Look = {"color": ORANGE, "mec": "black", "ms": 16, "ls": "none", "zorder": 4}
            axes.plot(*(1e3 * point[:, at]).T, "*", label="the task's posture", **star)
        if plan.workspace.height > -math.inf and pair[1] == 2:
            axes.axhline(1e3 * plan.workspace.height, color=LIMIT_COLOUR, ls="--", lw=1.2, zorder=2, label="kept above")
        names = [f"{'xyz'[k]} [mm]" for k in pair]
        axes.set(xlabel=names[0], ylabel=names[1], aspect="equal")
        axes.locator_params(nbins=6)
    legend(figure, beside=len(pairs) == 1)
    return figure


@styled
def plot_plan_errors(plan: MeasurementPlan) -> Figure:
    """Expected standard errors before, with the plan, and with as many random postures. Above what the plan is made
    for, over its value with the plan; below every parameter by itself [mrad or mm], logarithmic: of these some may come
    out worse than with random postures, as the plan is chosen for all of them together. Hollow squares: before; hollow
    diamonds: random postures; dots: the plan."""
    rows = {unit: [i for i in plan.listed if plan.parameters[i].unit == unit] for unit in ("rad", "m")}
    drawn = [unit for unit in rows if rows[unit]]
    # What the plan is judged by: name, value before (NaN for parameters, as some were not determined at all) and with
    # random postures, over that with the plan.
    merits = [] if plan.purpose == "task" else [("all parameters (geometric mean)", math.nan, plan.gain)]
    if plan.target is not None and plan.after.task > 0:
        ratios = [stage.task / plan.after.task for stage in (plan.before, plan.random)]
        merits.append(("tool point at the task", ratios[0], ratios[1]))
    most = max((len(r) for r in rows.values()), default=1)
    figure = new_figure(2.1 + 0.23 * (len(merits) + most))
    grid = figure.add_gridspec(2, max(len(drawn), 1), height_ratios=(len(merits) + 0.6, most + 0.6))
    _together(figure.add_subplot(grid[0, :]), plan, merits)
    for number, unit in enumerate(drawn):
        factor, written = ERROR_UNITS[unit]
        axes = figure.add_subplot(grid[1, number])
        before, after, random = (stage.std[rows[unit]] * factor for stage in (plan.before, plan.after, plan.random))
        _dots(axes, [plan.parameters[i].name for i in rows[unit]], before, after, random, len(plan.q))
        axes.set_xscale("log")
        decimals(axes.xaxis)
        axes.set_xlabel(f"expected standard error [{written}]")
        if number == 0:
            axes.set_title(_PARAMETER_TITLES[plan.purpose], loc="left")
    legend(figure)
    return figure


def _together(axes: Axes, plan: MeasurementPlan, merits: list[tuple[str, float, float]]) -> None:
    """The merits of the plan as multiples of its own error."""
    before, random = (np.array([merit[k] for merit in merits]) for k in (1, 2))
    _dots(axes, [name for name, *_ in merits], before, np.ones(len(merits)), random, len(plan.q))
    largest = float(np.nanmax([*random, 1.0]))
    for k, value in enumerate(random):
        at, text = (max(value, 1.0), k), f"{value:.2f} times the planned error"
        axes.annotate(text, at, xytext=(8, 0), textcoords="offset points", va="center")
    # Farther than three times the largest, a value is named in the title.
    far = [f" ({name}, before: {value:.3g})" for name, value, _ in merits if value > 3.0 * largest]
    axes.set_xlim(min(0.95 * float(np.nanmin([*random, 1.0])), 0.9), 1.0 + 1.9 * max(largest - 1.0, 0.15))
    axes.set_title("Together: what the plan is chosen and judged by" + "".join(far), loc="left")
    axes.set_xlabel("standard error over that of the plan")


def _dots(axes: Axes, names: Sequence[str], before: Array, after: Array, random: Array, count: int) -> None:
    """The three stages (r,) on a line a name, NaN where there is none; those below are larger and hollow, so that all
    are seen where they meet."""
    y, three = np.arange(len(names), dtype=float), np.array([before, after, random])
    axes.hlines(y, np.fmin.reduce(three), np.fmax.reduce(three), color=LIGHT, lw=1.5, zorder=1)
    hollow: Look = {"mfc": "none", "mew": 1.8, "ls": "none"}
    axes.plot(before, y, "s", color=GREY, ms=9, zorder=2, label="before", **hollow)
    axes.plot(random, y, "D", color=ORANGE, ms=9, zorder=3, label=f"{count} random postures (median)", **hollow)
    axes.plot(after, y, "o", color=BLUE, ms=5, zorder=4, ls="none", label="planned")
    axes.set_yticks(y, names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
