"""What may have changed, how probable each change is, and what it does to the errors of the new rows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import rms_length
from posture_opt.report.page.colours import BLUE, LIGHT, ORANGE
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import legend_below, styled
from posture_opt.statements.notation import length, length_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posture_opt.changes.what_changed import Recheck

_MAX_BARS = 8


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


@styled
def plot_recheck_rows(found: Recheck) -> Figure:
    """Position error of every row [µm or mm] in the order of the file: of the file, and with what changed."""
    from matplotlib.ticker import MaxNLocator

    unit, factor = length_unit([found.before])
    number = np.arange(1, len(found.data) + 1)
    figure = new_figure(3.6)
    axes = figure.add_subplot()
    shown = [(found.errors_before, ORANGE, "s", "as in the file")]
    if found.after < found.before:
        shown.append((found.errors_after, BLUE, "o", "with what changed"))
    for errors, colour, mark, label in shown:
        size = np.linalg.norm(errors, axis=1)
        axes.plot(
            number, factor * size, mark, color=colour, ms=6, mec="white", ls="none",
            label=f"{label}: {length(rms_length(errors), among=[found.before])} RMS",
        )  # fmt: skip
    axes.set(xlabel="row", ylabel=f"position error [{unit}]")
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_below(figure)
    return figure
