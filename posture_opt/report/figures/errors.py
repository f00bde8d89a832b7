"""Errors of models of an arm: predicted about the target, and row by row before and after a correction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.numerics import Array, rms
from posture_opt.report.figures.cloud import clearance_lines, decimals, frame_target, mark_origin, view_basis
from posture_opt.report.page.colours import BLUE, GREEN, LIGHT, MODEL_COLOURS, ORANGE, PURPLE
from posture_opt.report.page.style import MODEL_DASHES, Look, legend, new_axes, new_figure, styled
from posture_opt.report.parts.model_tables import distinct_columns
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements.notation import length, length_unit
from posture_opt.uncertainty.regions import Ellipsoid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt import Comparison, Compensation, Recheck
    from posture_opt.selection.comparison.predicted_error import PredictedError

_MARGIN = 1.12


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
    extents = [_extent(predicted, B) for shown in panels.values() for predicted in shown.values()]
    if not found.reference:
        # Farther off than 30 times the largest own ellipse, only the legend states it.
        own = max(_extent(column.judged[name].worst, B) for name, column in found.answered.items())
        extents = [extent for extent in extents if extent <= 30.0 * own]
    half = _MARGIN * max(extents)
    unit, scale = length_unit([half])
    figure = new_figure(5.0 if found.reference else 4.9)
    looks = {name: (f"planned with {name}", *_LOOKS[k % len(_LOOKS)]) for k, name in enumerate(found.answers)}
    if found.reference and set(found.answers) <= set(_MARKS):
        looks = {n: (MODEL_NAMES[n], MODEL_COLOURS[n], MODEL_DASHES[n], _MARKS[n]) for n in found.answers}
    for axes, (judge, shown) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True):
        for name, predicted in shown.items():
            _draw(axes, predicted, B, (scale, half), looks[name])
        mark_origin(axes, "target")
        clearance_lines(axes, station.task_spread, B, scale, half * scale)
        frame_target(axes, station.task_spread, B, half * scale, unit)
        if not found.reference:
            axes.set_title(f"predicted by {judge}")
    legend(figure, beside=bool(found.reference))
    return figure


def _region(predicted: PredictedError, B: Array) -> Ellipsoid:
    """The predicted error as an ellipse in the plane of the basis B (2, 3) [m]."""
    return Ellipsoid(B @ predicted.miss, B @ predicted.covariance @ B.T)


def _extent(predicted: PredictedError, B: Array) -> float:
    """How far a 95 % ellipse reaches from the target [m], along either axis of the plane."""
    return float(np.abs(_region(predicted, B).points(0.95)).max())


def _draw(
    axes: Axes, predicted: PredictedError, B: Array, frame: tuple[float, float], look: tuple[str, str, Any, str]
) -> None:
    """One ellipse with its centre, ``frame`` the scale and half the width [m]; outside of it, its distance alone.
    ``look`` is label, colour, dashes and mark."""
    (scale, half), (label, colour, dashes, mark) = frame, look
    region = _region(predicted, B)
    if _extent(predicted, B) > _MARGIN * half:
        axes.plot([], [], mark, color=colour, label=f"{label}: {length(predicted.distance)} off, outside")
        return
    boundary = (scale * region.points(0.95)).T
    # An ellipse below 3 % of the picture hides behind the mark of its centre.
    large = float(np.ptp(boundary, axis=1).max()) > 0.03 * 2 * scale * half
    label = f"{label}: 95 % ellipse"
    axes.fill(*boundary, facecolor=colour, alpha=0.12, lw=0)
    axes.plot(*boundary, color=colour, ls=dashes, label=label if large else None)
    hidden = None if large else f"{label} smaller than this mark"
    axes.plot(*(scale * region.center), mark, color=colour, ms=7, mec="white", ls="none", zorder=7, label=hidden)


_STAGE_LOOKS: tuple[Look, ...] = ({"color": ORANGE, "marker": "s"}, {"color": BLUE, "marker": "o"})


@styled
def plot_compensation(found: Compensation) -> Figure:
    """Both errors of every target [µm or mm], in the order of the targets; logarithmic. Squares: where the joint values
    as given lead; dots: the expected error of the compensated ones; a line joins both. A dot near its square is a
    target whose error is uncertain rather than known: compensation cannot remove it."""
    least = max(float(found.left.max()) * 1e-3, 1e-9)  # what was not off at all still shows, at the lower edge
    sizes = {"as given": found.off, "compensated": found.left}
    figure, axes = _rows_figure(sizes, "target, in the order of the file", "distance from the target", least)
    axes.set_yscale("log")
    axes.margins(x=0.02, y=0.12)
    decimals(axes.yaxis)
    legend(figure)
    return figure


@styled
def plot_recheck_rows(found: Recheck) -> Figure:
    """Position error of every row [µm or mm] in the order of the file: of the file, and with what changed."""
    sizes = {"as in the file": np.linalg.norm(found.errors_before, axis=1)}
    if found.after < found.before:
        sizes["with what changed"] = np.linalg.norm(found.errors_after, axis=1)
    figure, axes = _rows_figure(sizes, "row", "position error")
    axes.set_ylim(bottom=0)
    legend(figure)
    return figure


def _rows_figure(sizes: dict[str, Array], rows: str, what: str, least: float | None = None) -> tuple[Figure, Axes]:
    """Errors (N,) [m] of some models over the numbers of their rows; the RMS is in the legend; ``least`` [m]."""
    from matplotlib.ticker import MaxNLocator

    among = [rms(size) for size in sizes.values()]
    unit, factor = length_unit(among)
    figure, axes = new_axes(3.8)
    shown = [factor * np.maximum(size, least or 0.0) for size in sizes.values()]
    number = np.arange(1, len(shown[0]) + 1)
    if least is not None:
        axes.vlines(number, shown[-1], shown[0], color=LIGHT, lw=1.5, zorder=1)
    for size, overall, look, label in zip(shown, among, _STAGE_LOOKS, sizes, strict=False):
        text = f"{label}: {length(overall, among=among)} RMS"
        axes.plot(number, size, ms=6, mec="white", ls="none", label=text, **look)
    axes.set(xlabel=rows, ylabel=f"{what} [{unit}]")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure, axes


@styled
def plot_recheck_changes(found: Recheck) -> Figure:
    """Probability [%] that nothing changed, and of the likeliest changes, from the top."""
    changes = found.changes[:8]
    labels = ["unchanged", *(change.name for change in changes)]
    values = np.array([found.unchanged, *(c.probability for c in changes)])
    figure, axes = new_axes(0.35 * len(labels) + 1.2)
    axes.barh(np.arange(len(labels)), 100 * values, color=[LIGHT, *[BLUE] * len(changes)])
    axes.set(xlabel="probability [%]", xlim=(0, 100), yticks=range(len(labels)), yticklabels=labels)
    axes.invert_yaxis()
    return figure
