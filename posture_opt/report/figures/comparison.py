"""Predicted tool points about the target in the postures of a comparison, as each of the models predicts them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.figures.cloud import clearance_lines, frame_target, mark_origin, view_basis
from posture_opt.report.page.colours import BLUE, GREEN, MODEL_COLOURS, ORANGE, PURPLE
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import MODEL_DASHES, legend_below, legend_beside, styled
from posture_opt.report.parts.comparison_parts import distinct_columns
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements.notation import length, length_unit
from posture_opt.uncertainty.regions.regions import Ellipsoid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.selection.comparison.comparison import Comparison
    from posture_opt.selection.comparison.predicted_error import PredictedError

_FAR_RATIO = 30.0  # times the largest ellipse of an arm in its own posture: farther off, only the legend states it
_HIDDEN_SHARE = 0.03  # of the picture: an ellipse that is smaller hides behind the mark of its centre
_MARGIN = 1.12


@dataclass(frozen=True)
class _Look:
    """The line, the mark and the legend of one answer."""

    label: str
    colour: str
    dashes: str
    mark: str


_LOOKS = ((BLUE, "-", "o"), (ORANGE, "--", "s"), (GREEN, "-.", "D"), (PURPLE, ":", "^"))
_MARKS = {"nominal": "s", "calibrated": "o", "extended": "D", "delivered": "^"}


@styled
def plot_comparison(found: Comparison) -> Figure:
    """The 95 % ellipses of all answers about the target, a panel for every model that judges them.

    In the panel of arm A the answer planned with A is the smallest; how much larger the others are there is what
    planning with the wrong arm costs. Models of one arm are judged by the reference alone.

    Raises:
        KeyError: the reference model has no posture.
    """
    columns = distinct_columns(found) if found.reference else found.answered
    station = columns[found.reference or next(iter(columns))].stations[0]
    B = view_basis(station.spread, station.task_spread)
    panels = {
        judge: {name: column.judged[judge].worst for name, column in columns.items() if judge in column.judged}
        for judge in found.judges
    }
    half = _MARGIN * _half_width(found, panels, B)
    unit, scale = length_unit([half])
    looks, figure = _looks(found), new_figure(5.0 if found.reference else 4.9)
    for axes, (judge, shown) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True):
        for name, predicted in shown.items():
            _draw(axes, predicted, B, (scale, half), looks[name])
        mark_origin(axes, "target")
        clearance_lines(axes, station.task_spread, B, scale, half * scale)
        frame_target(axes, station.task_spread, B, half * scale, unit)
        if not found.reference:
            axes.set_title(f"predicted by {judge}")
    (legend_beside if found.reference else legend_below)(figure)
    return figure


def _half_width(found: Comparison, panels: Mapping[str, Mapping[str, PredictedError]], B: Array) -> float:
    """Half the width of the picture [m]: all ellipses of models of one arm; those of other arms that are not far."""
    extents = [_extent(predicted, B) for shown in panels.values() for predicted in shown.values()]
    if found.reference:
        return max(extents)
    own = max(_extent(column.judged[name].worst, B) for name, column in found.answered.items())
    return max(extent for extent in extents if extent <= _FAR_RATIO * own)


def _looks(found: Comparison) -> dict[str, _Look]:
    """Name of an answer -> how it is drawn: models of one arm as in every other figure."""
    if found.reference and set(found.answers) <= set(_MARKS):
        return {
            name: _Look(MODEL_NAMES[name], MODEL_COLOURS[name], MODEL_DASHES[name], _MARKS[name])
            for name in found.answers
        }
    return {name: _Look(f"planned with {name}", *_LOOKS[k % len(_LOOKS)]) for k, name in enumerate(found.answers)}


def _region(predicted: PredictedError, B: Array) -> Ellipsoid:
    """The predicted error as an ellipse in the plane of the basis B (2, 3) [m]."""
    return Ellipsoid(B @ predicted.miss, B @ predicted.covariance @ B.T)


def _extent(predicted: PredictedError, B: Array) -> float:
    """How far a 95 % ellipse reaches from the target [m], along either axis of the plane."""
    return float(np.abs(_region(predicted, B).points(0.95)).max())


def _draw(axes: Axes, predicted: PredictedError, B: Array, frame: tuple[float, float], look: _Look) -> None:
    """One ellipse with its centre, ``frame`` the scale and half the width [m]; outside of it, its distance alone."""
    scale, half = frame
    region = _region(predicted, B)
    if _extent(predicted, B) > _MARGIN * half:
        label = f"{look.label}: {length(predicted.distance)} off, outside"
        axes.plot([], [], look.mark, color=look.colour, label=label)
        return
    boundary = (scale * region.points(0.95)).T
    large = float(np.ptp(boundary, axis=1).max()) > _HIDDEN_SHARE * 2 * scale * half
    label = f"{look.label}: 95 % ellipse"
    axes.fill(*boundary, facecolor=look.colour, alpha=0.12, lw=0)
    axes.plot(*boundary, color=look.colour, ls=look.dashes, label=label if large else None)
    hidden = None if large else f"{label} smaller than this mark"
    centre = scale * region.center
    axes.plot(*centre, look.mark, color=look.colour, ms=7, mec="white", ls="none", zorder=7, label=hidden)
