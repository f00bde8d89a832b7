"""Maps of bias and spread over the targets, with the measured errors over them in the same colours.

Bias is where the arm lands on the average without its corrections; spread is what no correction takes away.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.figures.target_map import (
    Canvas,
    draw_layer,
    finish,
    new_panels,
    plot_line,
)
from posture_opt.report.page.colours import COLOUR_MAP
from posture_opt.report.page.style import styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.validation.accuracy_map import AccuracyMap

_ARROW_CELL_SHARE = 0.9  # of a cell's shorter side: the longest arrow
_MIN_ARROW_SHARE = 0.05  # of the longest arrow: below it an arrow is a dot


@styled
def plot_bias(found: AccuracyMap) -> Figure:
    """How far off the target the arm lands without its corrections [mm], and which way.

    Colours are the length of the bias; arrows its part in the plane of the figure, all enlarged by the factor in the
    legend. Dots are measured rows, in the same colours: where a dot vanishes in its cell, the prediction is true
    there.
    """
    measured = None if found.measured is None else found.measured.uncorrected
    return _plot(found, found.distance, "mean distance from the target, uncorrected", measured, arrows=True)


@styled
def plot_spread_map(found: AccuracyMap) -> Figure:
    """The distance from its mean that the tool point keeps with 95 % probability [mm], over the targets.

    Axes are two coordinates of the grid [mm], a panel a layer. Dots are measured rows in the same colours, with the
    corrections: 95 % of them should be no brighter than their cell.
    """
    measured = None if found.measured is None else found.measured.corrected
    return _plot(found, found.radius95, "distance from its mean, 95 % probability", measured, arrows=False)


def _plot(found: AccuracyMap, values: Array, label: str, measured: Array | None, *, arrows: bool) -> Figure:
    """One of both maps, or a curve where the targets are on a line.

    Args:
        values: (N,) [m], one for each target.
        label: what the colours are, without the unit.
        measured: (M,) [m], one for each measured row; None where there are none.
        arrows: whether the bias is drawn in the cells.
    """
    grid, targets = found.grid, found.targets
    if grid.shape[:2] == (1, 1):
        return plot_line(grid, label, values)
    near = found.measured is not None and found.measured.near
    canvas = Canvas.of(targets, values, None if measured is None else measured[near])
    figure, panels = new_panels(canvas)
    for axes, layer in panels:
        mesh = draw_layer(axes, canvas, targets, values, layer)
        if arrows:
            _arrows(axes, canvas, found, layer)
        if measured is not None:
            _rows(axes, canvas, found, measured, layer)
    finish(figure, panels, mesh, f"{label} [{canvas.unit}]")
    return figure


def _arrows(axes: Axes, canvas: Canvas, found: AccuracyMap, layer: int) -> None:
    """The part of the bias in the plane of the figure, enlarged alike everywhere.

    Nothing is drawn where the bias is across the figure: its part in the plane is below 5 % of its length. Of many
    cells, some are chosen so that about twelve arrows fit along the longer side.
    """
    grid = canvas.grid
    inside = canvas.layers(found.bias @ grid.axes[:2].T)[layer]
    longest = float(np.nanmax(np.linalg.norm(found.bias @ grid.axes[:2].T, axis=1)))
    if longest <= _MIN_ARROW_SHARE * float(np.nanmax(found.distance)):
        return  # it lies across the figure
    step = max(1, round(max(grid.shape[1:]) / 12))
    cell = 1e3 * min(grid.sides[:2]) * step
    enlarged = _ARROW_CELL_SHARE * cell / longest
    at = np.meshgrid(1e3 * grid.values[0], 1e3 * grid.values[1])
    shown = (slice(step // 2, None, step),) * 2
    u, v = (part[shown] for part in at)
    du, dv = (enlarged * inside[..., k][shown] for k in range(2))
    # In the units of the axes, centred in its cell: the picture says where it goes, the colour how far.
    axes.quiver(
        u - du / 2, v - dv / 2, du, dv, angles="xy", scale_units="xy", scale=1, width=0.004, color="white",
        edgecolor="black", linewidth=0.5, zorder=4,
    )  # fmt: skip
    label = f"which way, enlarged {float(f'{enlarged / 1e3:.2g}'):g}\N{MULTIPLICATION SIGN}"
    axes.plot([], [], ls="none", marker=">", color="white", mec="black", ms=7, label=label)


def _rows(axes: Axes, canvas: Canvas, found: AccuracyMap, lengths: Array, layer: int) -> None:
    """Measured rows near this layer, in the colours of the cells.

    Args:
        lengths: (M,) [m] errors of all measured rows.
        layer: number of the layer along the third axis of the grid.
    """
    assert found.measured is not None
    measured, grid = found.measured, canvas.grid
    per_layer = grid.shape[1] * grid.shape[2]
    mine = measured.near & (measured.cell // per_layer == layer)
    if not mine.any():
        return
    u, v, _ = 1e3 * grid.coordinates(measured.place[mine]).T
    size = float(np.clip(4000 / np.count_nonzero(mine), 12, 45))
    axes.scatter(
        u, v, c=canvas.scale * lengths[mine], cmap=COLOUR_MAP, norm=canvas.norm, s=size, edgecolors="white",
        linewidths=0.8, zorder=5, label="measured", clip_on=False,
    )  # fmt: skip
