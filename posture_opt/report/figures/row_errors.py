"""Errors row by row before and after something is corrected, and how probable it is that each thing changed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array, rms
from posture_opt.report.figures.axis_names import decimals
from posture_opt.report.page.colours import BLUE, LIGHT, ORANGE
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import Look, legend_below, styled
from posture_opt.statements.notation import length, length_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.changes.what_changed import Recheck
    from posture_opt.compensation.compensation import Compensation

_MAX_BARS = 8
_LOOKS: tuple[Look, ...] = ({"color": ORANGE, "marker": "s"}, {"color": BLUE, "marker": "o"})


@styled
def plot_compensation(found: Compensation) -> Figure:
    """Both errors of every target [µm or mm], in the order of the targets; logarithmic.

    Squares: where the joint values as given lead; dots: the expected error of the compensated ones; a line joins both.
    A dot near its square is a target whose error is uncertain rather than known: compensation cannot remove it. Errors
    of zero are drawn at the lower edge.
    """
    least = max(float(found.left.max()) * 1e-3, 1e-9)  # what was not off at all still shows, at the lower edge
    sizes = {"as given": found.off, "compensated": found.left}
    figure, axes = _rows_figure(sizes, "target, in the order of the file", "distance from the target", least)
    axes.set_yscale("log")
    axes.margins(x=0.02, y=0.12)
    decimals(axes.yaxis)
    legend_below(figure)
    return figure


@styled
def plot_recheck_rows(found: Recheck) -> Figure:
    """Position error of every row [µm or mm] in the order of the file: of the file, and with what changed."""
    sizes = {"as in the file": np.linalg.norm(found.errors_before, axis=1)}
    if found.after < found.before:
        sizes["with what changed"] = np.linalg.norm(found.errors_after, axis=1)
    figure, axes = _rows_figure(sizes, "row", "position error")
    axes.set_ylim(bottom=0)
    legend_below(figure)
    return figure


def _rows_figure(sizes: dict[str, Array], rows: str, what: str, least: float | None = None) -> tuple[Figure, Axes]:
    """Errors (N,) [m] of some models over the numbers of their rows; the RMS is in the legend.

    Args:
        rows: label of the axis of the rows; ``what`` of that of the errors, without the unit.
        least: error [m] at which smaller ones are drawn, with lines between both models; None: as they are.
    """
    from matplotlib.ticker import MaxNLocator

    among = [rms(size) for size in sizes.values()]
    unit, factor = length_unit(among)
    figure = new_figure(3.8)
    axes = figure.add_subplot()
    shown = [factor * np.maximum(size, least or 0.0) for size in sizes.values()]
    number = np.arange(1, len(shown[0]) + 1)
    if least is not None:
        axes.vlines(number, shown[-1], shown[0], color=LIGHT, lw=1.5, zorder=1)
    for size, overall, look, label in zip(shown, among, _LOOKS, sizes, strict=False):
        text = f"{label}: {length(overall, among=among)} RMS"
        axes.plot(number, size, ms=6, mec="white", ls="none", label=text, **look)
    axes.set(xlabel=rows, ylabel=f"{what} [{unit}]")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure, axes


@styled
def plot_recheck_changes(found: Recheck) -> Figure:
    """Probability [%] that nothing changed, and of the likeliest changes, from the top."""
    changes = found.changes[:_MAX_BARS]
    labels = ["unchanged", *(change.name for change in changes)]
    values = np.array([found.unchanged, *(c.probability for c in changes)])
    figure = new_figure(0.35 * len(labels) + 1.2)
    axes = figure.add_subplot()
    axes.barh(np.arange(len(labels)), 100 * values, color=[LIGHT, *[BLUE] * len(changes)])
    axes.set(xlabel="probability [%]", xlim=(0, 100), yticks=range(len(labels)), yticklabels=labels)
    axes.invert_yaxis()
    return figure
