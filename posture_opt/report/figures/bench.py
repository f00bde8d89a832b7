"""The bench: the spread over the placement of the workpiece, and where its features then lie.

It shows how much is lost where the workpiece cannot be put at its best place.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.page.colours import COLOUR_MAP, GREY, VERMILLION
from posture_opt.report.page.style import legend, new_axes, styled
from posture_opt.selection.answer.placement import COORDINATES
from posture_opt.statements.notation import length_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.selection.answer.placement import BenchMap
    from posture_opt.selection.answer.solution import Solution

_EDGE_SHARE = 0.25  # of the width: nearer to the edge, a name is above or below its point
_UNIT_FACTORS = (1e3, 1e3, 1e3, math.degrees(1.0))
_COORDINATE_LABELS = ("x of the workpiece [mm]", "y of the workpiece [mm]", "z of the workpiece [mm]", "yaw [deg]")


@styled
def plot_bench(found: Solution) -> Figure:
    """Spread over two coordinates of the placement; hatched: not every feature can be done there. Colours are the
    standard deviation of the worst feature, or the mean of all [µm or mm]; further free coordinates are held as in the
    answer, as the title says. The star is the placement of the answer."""
    bench = found.bench
    assert bench is not None, "a map has two axes"
    assert found.placement is not None
    figure, axes = new_axes(5.2)
    _draw_map(figure, axes, found, bench)
    level = bench.axes == (0, 1)
    if level:
        _draw_features(axes, found)
    first, second = bench.axes
    here = [_UNIT_FACTORS[k] * float(found.w[k]) for k in bench.axes]
    axes.plot(*here, "*", color=VERMILLION, mec="white", ms=17, zorder=9, label="workpiece placed here")
    axes.set(xlabel=_COORDINATE_LABELS[first], ylabel=_COORDINATE_LABELS[second])
    if level:
        axes.set_aspect("equal")
    others = [k for k in range(4) if k not in bench.axes and found.placement.free[k]]
    if others:
        held = ", ".join(
            f"{COORDINATES[k]} {_UNIT_FACTORS[k] * found.w[k]:.1f} {'deg' if k == 3 else 'mm'}" for k in others
        )
        axes.set_title(f"at {held}, as in the answer")
    legend(figure, beside=True)
    return figure


def _draw_map(figure: Figure, axes: Axes, found: Solution, bench: BenchMap) -> None:
    """Colours where all features can be done, hatching elsewhere; NaN in ``bench.sigma`` marks the latter."""
    from matplotlib.patches import Rectangle
    from matplotlib.ticker import MaxNLocator

    unit, factor = length_unit([float(s) for s in found.sigmas])  # that of the answer in the report
    x, y = (_UNIT_FACTORS[k] * values for k, values in zip(bench.axes, bench.values, strict=True))
    bad = ~np.isfinite(bench.sigma)
    axes.set_facecolor("white")
    if bad.any():
        step = [(v[-1] - v[0]) / (len(v) - 1) for v in (x, y)]
        size = [v[-1] - v[0] + d for v, d in zip((x, y), step, strict=True)]
        corner = (x[0] - step[0] / 2, y[0] - step[1] / 2)
        cannot = Rectangle(corner, *size, hatch="////", fc="white", ec=GREY, lw=0.5, label="a feature cannot be done")
        cannot.set_zorder(1)
        axes.add_patch(cannot)
    if (~bad).any():
        mesh = axes.pcolormesh(
            x, y, np.ma.masked_invalid(factor * bench.sigma.T), cmap=COLOUR_MAP, shading="nearest", zorder=2
        )
        mesh.set_rasterized(True)
        bar = figure.colorbar(mesh, ax=axes, shrink=0.85, ticks=MaxNLocator(7))
        what = "mean" if found.task.combine == "mean" else "worst feature"
        bar.set_label(f"standard deviation, {what} [{unit}]")


def _draw_features(axes: Axes, found: Solution) -> None:
    """The features as points [mm], the worst one ringed; their names where there is room."""
    from matplotlib.patches import Rectangle

    points = 1e3 * np.array([station.target.lower for station in found.stations])
    assert found.bench is not None
    low, high = (np.array([1e3 * values[end] for values in found.bench.values]) for end in (0, -1))
    if np.any(points[:, :2] < low) or np.any(points[:, :2] > high):
        frame = Rectangle(tuple(low), *(high - low), fill=False, ec=GREY, lw=1.2)
        frame.set(zorder=6, label="range of the workpiece's origin")
        axes.add_patch(frame)
    axes.plot(points[:, 0], points[:, 1], "o", color="black", mec="white", ms=6, zorder=7, label="features")
    worst = points[found.worst_index]
    axes.plot(*worst[:2], "o", color="none", mec=VERMILLION, mew=2, ms=11, zorder=7, label="worst feature")
    # The part may reach beyond the range of its origin, which the colours are over.
    for pick, limits, k in ((axes.set_xlim, axes.get_xlim(), 0), (axes.set_ylim, axes.get_ylim(), 1)):
        margin = 0.04 * (limits[1] - limits[0])
        pick(min(limits[0], points[:, k].min() - margin), max(limits[1], points[:, k].max() + margin))
    # More names do not fit next to their points.
    if len(points) <= 6:
        middle = points[:, :2].mean(axis=0)
        for name, point in zip(found.names, points, strict=True):
            _name(axes, name, point[:2], point[:2] - middle)


def _name(axes: Axes, name: str, point: Array, outward: Array) -> None:
    """The name of a feature on that side of its point (2,) which is away from the others, within the axes."""
    right, up = outward[0] >= 0, outward[1] >= 0
    left, wide = axes.get_xlim()[0], float(np.ptp(axes.get_xlim()))
    share = (point[0] - left) / wide
    at_edge = share > 1 - _EDGE_SHARE if right else share < _EDGE_SHARE
    text = axes.annotate(
        name, (point[0], point[1]), textcoords="offset points", zorder=8, va="bottom" if up else "top",
        xytext=(0 if at_edge else 8 if right else -8, (9 if at_edge else 5) * (1 if up else -1)),
        ha="center" if at_edge else "left" if right else "right",
    )  # fmt: skip
    text.set_bbox({"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 1})
