"""Whether the predicted spread is true: reliability of the regions, and the scatter of each joint."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.report.page.colours import BLUE, GREY, LIGHT, MODEL_COLOURS, VERMILLION
from posture_opt.report.page.style import MODEL_DASHES, legend, name_rows, new_axes, new_figure, styled
from posture_opt.report.text.words import MODEL_NAMES, REGIONS
from posture_opt.validation.coverage import RELIABILITY_LEVELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.validation.spread_check import SpreadCheck


@styled
def plot_reliability(found: SpreadCheck) -> Figure:
    """The share of the rows in the predicted region of every probability: on the diagonal the prediction is true. Below
    it errors are larger than predicted. The grey band is where 95 % of data sets would lie, were it true; the dots are
    at the 95 % region with the interval of the share."""
    figure, axes = new_axes(5.0)
    nominal = found.coverage["nominal"]
    true = "the file's spread true" if found.stated else "the instrument all there is"
    levels = 100 * np.array([0.0, *RELIABILITY_LEVELS, 1.0])
    band = 100 * np.vstack([[0, 0], nominal.band, [1, 1]])
    axes.fill_between(levels, band[:, 0], band[:, 1], color=LIGHT, lw=0, label=f"95 % of data sets, were {true}")
    axes.plot([0, 100], [0, 100], color=GREY, lw=1)
    for name, c in found.coverage.items():
        n = len(c.probability)
        shares = 100 * np.arange(1, n + 1) / n
        label = MODEL_NAMES[name] + ("" if name != "nominal" or found.stated else " (the instrument alone)")
        curve = np.r_[0.0, 100 * c.probability], np.r_[0.0, shares]
        axes.step(*curve, where="post", color=MODEL_COLOURS[name], ls=MODEL_DASHES[name], label=label)
        width = {"nominal": 5, "calibrated": 2.5}[name]  # where both overlap, both are seen
        ends = 100 * np.array(c.interval)
        axes.plot([95, 95], ends, color=MODEL_COLOURS[name], lw=width, solid_capstyle="butt", zorder=4)
        axes.plot(95, 100 * c.share, "o", color=MODEL_COLOURS[name], mec="white", ms=9, zorder=5)
    region = REGIONS[nominal.dimension].removeprefix("95 % ")
    axes.axvline(95, color=GREY, lw=0.8, ls=":")
    axes.set(xlim=(0, 101), ylim=(0, 101), aspect="equal")
    axes.set_xlabel(f"predicted: probability of the {region} [%] (dotted: 95 %)")
    axes.set_ylabel("measured: rows inside it [%]")
    legend(figure, beside=True)
    return figure


@styled
def plot_joint_scatter(found: SpreadCheck) -> Figure:
    """Estimated standard deviations of joints and instrument with their 95 % intervals, and the stated ones. Angles in
    mrad in the upper panel, lengths in mm in the lower one. Bars that end at an arrow have no upper end that the data
    determine."""
    noise = found.noise
    assert noise is not None
    turning, sliding = list[tuple[Any, ...]](), list[tuple[Any, ...]]()
    for k in map(int, np.flatnonzero(found.shown)):
        name, _, kind = noise.names[k].rpartition(".")
        row = (name, noise.sigma[k], *noise.interval[k], found.stated_sigma[k])
        (sliding if kind == "d" else turning).append(row)
    sliding.append(("instrument", noise.instrument, *noise.instrument_interval, found.instrument))
    panels = [*([(turning, "mrad")] if turning else []), (sliding, "mm")]
    heights = [len(part) for part, _ in panels]
    figure = new_figure(1.3 + 0.28 * sum(heights) + 0.4 * len(panels))
    grid = figure.add_gridspec(len(panels), 1, height_ratios=[h + 0.8 for h in heights])
    for k, (part, unit) in enumerate(panels):
        _bars(figure.add_subplot(grid[k]), part, unit, 1e3)
    legend(figure)
    return figure


def _bars(axes: Axes, rows: list[tuple[Any, ...]], unit: str, factor: float) -> None:
    """One panel: bars of estimates, lines of their intervals, diamonds of stated values; ``rows`` (name, σ, lower end,
    upper end, stated σ)."""
    known = [high for _, sigma, _, high, _ in rows if math.isfinite(high) and sigma > 0]
    largest = max([*(sigma for _, sigma, *_ in rows), *(stated for *_, stated in rows)], default=0.0)
    near = [high for high in known if high < 4 * largest]
    # Beyond 1.15 times the largest value that the data determine, bars are cut off.
    edge = 1.15 * factor * max([largest, *near], default=1.0) or 1.0
    labels = {"estimated": True, "95 % interval": True, "stated": True}
    for k, (_, sigma, low, high, stated) in enumerate(rows):
        beyond = not factor * high <= edge
        end = edge if beyond else factor * high
        label = "estimated" if labels.pop("estimated", 0) else None
        axes.barh(k, factor * sigma, color=BLUE, height=0.6, zorder=2, label=label)
        label = "95 % interval" if labels.pop("95 % interval", 0) else None
        axes.plot([factor * low, end], [k, k], color="black", lw=1.6, zorder=3, label=label)
        if beyond:
            axes.plot(end, k, ">", color="black", ms=6, zorder=4, clip_on=False)
        if stated > 0:
            label = "stated" if labels.pop("stated", 0) else None
            axes.plot(factor * stated, k, "D", color=VERMILLION, ms=6, mec="white", zorder=5, label=label)
    name_rows(axes, {k: row[0] for k, row in enumerate(rows)})
    axes.set(ylim=(len(rows) - 0.5, -0.5), xlim=(0, edge), xlabel=f"standard deviation [{unit}]")
