"""What to measure next: where the tool point goes, and what that tells of each parameter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from posture_opt.measurements.measurements import nominal_poses
from posture_opt.report.measurement_plan_report import shown
from posture_opt.report.style import (
    BLUE,
    GREY,
    LIGHT,
    ORANGE,
    VERMILLION,
    legend_below,
    legend_beside,
    new_figure,
    styled,
)

if TYPE_CHECKING:
    from posture_opt.experiments.measurement_plan import MeasurementPlan

_STILL = 1e-6  # m
_FAINT = "#BDBDBD"


@styled
def plot_plan_points(plan: MeasurementPlan) -> Figure:
    """The planned tool points, the given ones and the task's, over those of random allowed postures, from each side."""
    moving = [k for k in range(3) if np.ptp(plan.reach[:, k]) > _STILL]
    pairs = [(0, 1), (0, 2)] if len(moving) == 3 else [(moving[0], moving[-1])]
    figure = new_figure(4.6)
    for number, pair in enumerate(pairs, start=1):
        axes = figure.add_subplot(1, len(pairs), number)
        at = list(pair)
        label = "random postures that keep clear"
        axes.plot(*(1e3 * plan.reach[:, at]).T, ".", color=_FAINT, ms=4, mew=0, zorder=1, label=label)
        if plan.given is not None:
            points, _ = nominal_poses(plan.robot, plan.given.q)
            axes.plot(*(1e3 * points[:, at]).T, "x", color=GREY, ms=5, mew=1.2, zorder=2, label="measured already")
        axes.plot(*(1e3 * plan.points[:, at]).T, "o", color=BLUE, mec="white", ms=8, zorder=3, label="to be measured")
        if plan.target is not None:
            point, _ = nominal_poses(plan.robot, plan.target.q[None])
            star: dict[str, Any] = {"color": ORANGE, "mec": "black", "ms": 16, "ls": "none", "zorder": 4}
            axes.plot(*(1e3 * point[:, at]).T, "*", label="the task's posture", **star)
        if plan.workspace.height > -math.inf and pair[1] == 2:
            axes.axhline(1e3 * plan.workspace.height, color=VERMILLION, ls="--", lw=1.2, zorder=2, label="kept above")
        names = [f"{'xyz'[k]} [mm]" for k in pair]
        axes.set(xlabel=names[0], ylabel=names[1], aspect="equal")
        axes.locator_params(nbins=6)
    (legend_beside if len(pairs) == 1 else legend_below)(figure)
    return figure


@styled
def plot_plan_errors(plan: MeasurementPlan) -> Figure:
    """Expected standard errors before, with the plan, and with as many random postures; logarithmic."""
    groups = [("rad", "deg", math.degrees(1.0)), ("m", "mm", 1e3)]
    rows = {
        unit: [i for i, p in enumerate(plan.parameters) if shown(plan, i) and p.unit == unit] for unit, *_ in groups
    }
    drawn = [group for group in groups if rows[group[0]]]
    figure = new_figure(1.3 + 0.24 * max((len(r) for r in rows.values()), default=1))
    for number, (unit, written, factor) in enumerate(drawn, start=1):
        axes = figure.add_subplot(1, len(drawn), number)
        _errors(axes, plan, rows[unit], factor)
        axes.set_xlabel(f"expected standard error [{written}]")
    legend_below(figure)
    return figure


def _errors(axes: Any, plan: MeasurementPlan, rows: list[int], factor: float) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    y = np.arange(len(rows))
    before, after, random = (stage.std[rows] * factor for stage in (plan.before, plan.after, plan.random))
    three = np.array([before, after, random])
    axes.hlines(y, np.fmin.reduce(three), np.fmax.reduce(three), color=LIGHT, lw=1.5, zorder=1)
    axes.plot(before, y, "s", color=GREY, ms=6, zorder=2, ls="none", label="before")
    axes.plot(random, y, "D", color=ORANGE, ms=6, zorder=3, ls="none", label=f"{len(plan.q)} random postures")
    axes.plot(after, y, "o", color=BLUE, ms=7, zorder=4, ls="none", label="planned")
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 200 * low else (1.0,), numticks=20))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yticks(y, [plan.parameters[i].name for i in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
