"""How far targets are missed with the given joint values, and what is left once these are compensated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import rms
from posture_opt.report.figures.axis_names import decimals
from posture_opt.report.page.colours import BLUE, LIGHT, ORANGE
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import legend_below, styled
from posture_opt.statements.notation import length, length_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posture_opt.compensation.compensation import Compensation


@styled
def plot_compensation(found: Compensation) -> Figure:
    """Both errors of every target [µm or mm], in the order of the targets; logarithmic.

    Squares: where the joint values as given lead; dots: the expected error of the compensated ones; a line joins both.
    The RMS is in the legend. A dot near its square is a target whose error is uncertain rather than known:
    compensation cannot remove it. Errors of zero are drawn at the lower edge.
    """
    from matplotlib.ticker import MaxNLocator

    off, left = found.off, found.left
    among = [rms(off), rms(left)]
    unit, factor = length_unit(among)
    least = max(float(left.max()) * 1e-3, 1e-9)  # what was not off at all still shows, at the lower edge
    number = np.arange(1, len(found) + 1)
    figure = new_figure(3.9)
    axes = figure.add_subplot()
    axes.vlines(
        number, factor * np.maximum(left, least), factor * np.maximum(off, least), color=LIGHT, lw=1.5, zorder=1
    )
    for values, size, colour, mark, label in (
        (off, among[0], ORANGE, "s", "as given"),
        (left, among[1], BLUE, "o", "compensated"),
    ):
        text = f"{label}: {length(size, among=among)} RMS"
        axes.plot(
            number, factor * np.maximum(values, least), mark, color=colour, ms=6, mec="white", ls="none", label=text
        )
    axes.set(yscale="log", xlabel="target, in the order of the file", ylabel=f"distance from the target [{unit}]")
    axes.margins(x=0.02, y=0.12)
    decimals(axes.yaxis)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_below(figure)
    return figure
