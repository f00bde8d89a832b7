"""Where the tool lands about the target in the posture of each of several models."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.report.figures.cloud import clearance_lines, frame_target, mark_origin, view_basis
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import MODEL_COLOURS, MODEL_DASHES, Look, legend_beside, styled
from posture_opt.report.text.units_text import length_unit
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.uncertainty.regions.regions import Ellipsoid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posture_opt.selection.comparison.plan_comparison import Comparison

_MARKS = {"nominal": "s", "calibrated": "o", "extended": "D", "delivered": "^"}
_SEEN = 0.03  # of the picture: an ellipse that is smaller hides behind the mark of its centre


@styled
def plot_landing(comparison: Comparison, models: Iterable[str] | None = None) -> Figure:
    """The 95 % ellipses of the postures of some models about the target, as the reference model predicts them.

    Args:
        models: names among the answers; None: all of them.

    Raises:
        KeyError: the reference model has no posture.
    """
    chosen, _ = comparison.answered[comparison.reference]
    B = view_basis(chosen.spread, chosen.task_spread)
    figure = new_figure(5.0)
    axes = figure.add_subplot()
    columns = {name: comparison.answered[name] for name in (comparison.answered if models is None else models)}
    regions = [
        (Ellipsoid(B @ predicted_error.miss, B @ predicted_error.covariance @ B.T), name)
        for name, (_, predicted_error) in columns.items()
    ]
    every = np.vstack([region.points(0.95) for region, _ in regions])
    half = 1.12 * float(np.abs(every).max())
    unit, scale = length_unit([half])
    for region, name in regions:
        colour, label = MODEL_COLOURS[name], MODEL_NAMES[name]
        boundary = (scale * region.points(0.95)).T
        large = float(np.ptp(boundary, axis=1).max()) > _SEEN * 2 * scale * half
        axes.fill(*boundary, facecolor=colour, alpha=0.12, lw=0)
        axes.plot(*boundary, color=colour, ls=MODEL_DASHES[name], label=f"{label}: 95 % ellipse" if large else None)
        hidden = None if large else f"{label}: 95 % ellipse smaller than this mark"
        look: Look = {"marker": _MARKS[name], "ms": 7, "mec": "white", "ls": "none"}
        axes.plot(*(scale * region.center), color=colour, zorder=7, label=hidden, **look)
    mark_origin(axes, "target")
    half *= scale
    clearance_lines(axes, chosen.task_spread, B, scale, half)
    frame_target(axes, chosen.task_spread, B, half, unit)
    legend_beside(figure)
    return figure
