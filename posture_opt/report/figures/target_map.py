"""Maps over a grid of targets: colours in the cells, hatching where there is no posture, the best target marked.

Axes are two coordinates of the grid [mm], a panel a layer of the third; all panels share one scale of colours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array
from posture_opt.report.page.colours import BLUE, COLOUR_MAP, LIGHT, ORANGE, VERMILLION
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import WIDTH, Look, legend_below, styled
from posture_opt.report.text.words import PARTS, line_words
from posture_opt.robot.robot import Robot
from posture_opt.statements.notation import length_unit
from posture_opt.units import fixed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    from posture_opt.selection.maps.map_points import Grid
    from posture_opt.selection.maps.target_map import TargetMap

_PANELS_WIDTH_INCH = WIDTH - 1.6  # the rest is the scale of colours with its numbers
_MAX_LAYERS = 9
_ARROW_SHARE = 0.14  # of the picture
_HATCH_OF_STATUS = {"not reached": "////", "requirement not met": "...."}
_STATUS_LABELS = {"not reached": "not reached", "requirement not met": "reached, but a requirement is not met"}


@dataclass(frozen=True)
class Canvas:
    """What all panels of a map share.

    Args:
        grid: of targets.
        norm: from lengths in ``unit`` to colours; ``scale`` converts m to the unit.
    """

    grid: Grid
    norm: Normalize
    unit: str
    scale: float

    @classmethod
    def of(cls, grid: Grid, values: Array, others: Array | None = None) -> Canvas:
        """A scale over ``values`` (N,) [m] and, where given, other lengths that are drawn with the same colours.

        Of the others, those above their 95 % quantile do not widen the scale; a range below 0.1 % is widened to 4 %.
        """
        seen = values[np.isfinite(values)]
        if others is not None and len(others):
            # One gross outlier must not wash out all the rest.
            seen = np.concatenate([seen, others[others <= np.quantile(others, 0.95)]])
        low, high = float(seen.min()), float(seen.max())
        unit, scale = length_unit([high])
        if high - low < 1e-3 * high:
            low, high = 0.98 * low, 1.02 * high
        from matplotlib.colors import Normalize

        return cls(grid, Normalize(scale * low, scale * high), unit, scale)

    def layers(self, values: NDArray[Any]) -> NDArray[Any]:
        """(W, V, U, ...) an array over all targets by layers."""
        return values.reshape(*self.grid.shape, *values.shape[1:])


@styled
def plot_target_map(found: TargetMap) -> Figure:
    """The smallest spread that a posture gives, over the targets of the grid.

    Colours are the standard deviation of the part that counts [µm or mm]; hatched cells have no posture, and the
    legend says why. The star is the best target, a cross the position in the problem: the difference of their colours
    is what moving the workpiece gains. Targets on a line are drawn as a curve.
    """
    label = f"standard deviation {PARTS[found.within]}"
    if found.grid.shape[1] == 1 and found.grid.shape[0] == 1:
        return plot_line(found.grid, label, found.sigma)
    canvas = Canvas.of(found.grid, found.sigma)
    statuses = np.array([map_point.status for map_point in found.map_points])
    figure, panels = new_panels(canvas)
    mesh: QuadMesh | None = None
    for axes, layer in panels:
        mesh = draw_cells(axes, canvas, canvas.layers(found.sigma)[layer])
        hatch_cells(axes, canvas, canvas.layers(statuses)[layer])
        _mark_spots(axes, canvas, found, layer)
    finish(figure, panels, mesh, f"{label} [{canvas.unit}]")
    return figure


def new_panels(canvas: Canvas) -> tuple[Figure, list[tuple[Axes, int]]]:
    """A figure with axes for each layer that is shown, and the numbers of these layers.

    Of many layers nine are shown, equally spaced, the outer ones among them.
    """
    count = canvas.grid.shape[0]
    shown = np.unique(np.linspace(0, count - 1, min(count, _MAX_LAYERS)).round().astype(int)).tolist()
    columns = min(len(shown), 3 if len(shown) not in (1, 2, 4) else 2)
    rows = math.ceil(len(shown) / columns)
    (u0, u1), (v0, v1) = edges_of(canvas.grid)
    # As high as the panels are for their width: no white bands, and a scale of colours of the same height.
    height = _PANELS_WIDTH_INCH / columns * min(max((v1 - v0) / (u1 - u0), 0.3), 1.4)
    figure = new_figure(rows * (height + 0.25) + 1.0)
    panels = []
    for k, layer in enumerate(shown):
        axes = figure.add_subplot(rows, columns, k + 1)
        _name_axes(axes, canvas.grid, layer, small=columns > 1)
        # Numbers at the left and below the lowest only: the panels get their room.
        axes.tick_params(labelleft=k % columns == 0, labelbottom=k + columns >= len(shown))
        axes.set_ylabel(axes.get_ylabel() if k % columns == 0 else "")
        axes.set_xlabel(axes.get_xlabel() if k + columns >= len(shown) else "")
        panels.append((axes, layer))
    return figure, panels


def edges_of(grid: Grid) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ends of the picture along u and v [mm]: half a cell beyond the outer targets."""
    (u, v, _), (du, dv, _) = grid.values, grid.sides
    return (1e3 * (u[0] - du / 2), 1e3 * (u[-1] + du / 2)), (1e3 * (v[0] - dv / 2), 1e3 * (v[-1] + dv / 2))


def _name_axes(axes: Axes, grid: Grid, layer: int, small: bool) -> None:
    """Labels, limits and the height of one layer.

    A turned grid has no coordinate axes: its labels say that they are offsets from the middle.
    """
    names = [line_words(e) for e in grid.axes]
    off = "" if grid.aligned else ", off the middle"
    axes.set(xlabel=f"{names[0]}{off} [mm]", ylabel=f"{names[1]}{off} [mm]", aspect="equal")
    if grid.aligned and (len(grid.values[2]) > 1 or abs(grid.values[2][0]) > 1e-9):
        axes.set_title(f"{names[2]} = {fixed(1e3 * grid.values[2][layer], 1)} mm")
    (u0, u1), (v0, v1) = edges_of(grid)
    axes.set(xlim=(u0, u1), ylim=(v0, v1))
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.locator_params(nbins=5 if small else 8)


def _corners(grid: Grid) -> tuple[Array, Array]:
    """(U + 1,) and (V + 1,) the edges of the cells [mm]."""
    (u0, u1), (v0, v1) = edges_of(grid)
    return np.linspace(u0, u1, len(grid.values[0]) + 1), np.linspace(v0, v1, len(grid.values[1]) + 1)


def draw_cells(axes: Axes, canvas: Canvas, values: Array) -> QuadMesh:
    """The cells of one layer, values (V, U) [m], NaN left empty; what it returns serves the scale of colours."""
    shown = np.ma.masked_invalid(canvas.scale * values)
    mesh = axes.pcolormesh(*_corners(canvas.grid), shown, cmap=COLOUR_MAP, norm=canvas.norm, zorder=1)
    mesh.set_rasterized(True)  # as paths, hairlines show between the cells
    return mesh


def hatch_cells(axes: Axes, canvas: Canvas, statuses: NDArray[Any]) -> None:
    """Grey hatching over the cells (V, U) without a posture, by what keeps the arm from it."""
    from matplotlib.collections import PolyCollection

    u, v = _corners(canvas.grid)
    for status, hatch in _HATCH_OF_STATUS.items():
        cells = [
            [(u[i], v[k]), (u[i + 1], v[k]), (u[i + 1], v[k + 1]), (u[i], v[k + 1])]
            for k, i in np.argwhere(statuses == status).tolist()
        ]
        if cells:
            look: Look = {"facecolor": "#EFEFEF", "edgecolor": "#B0B0B0", "hatch": hatch, "lw": 0}
            axes.add_collection(PolyCollection(cells, zorder=1, label=_STATUS_LABELS[status], **look))


def _mark_spots(axes: Axes, canvas: Canvas, found: TargetMap, layer: int) -> None:
    """The best place, the file's own position, base and direction."""
    mark_own(axes, canvas, found, layer)
    _mark(axes, canvas, found.best.position, layer, "best place", marker="*", color=ORANGE, mec="black", ms=18)
    mark_base(axes, canvas, found.optimisation_problem.robot)
    mark_direction(axes, canvas.grid, found.target.direction)


def mark_own(axes: Axes, canvas: Canvas, found: TargetMap, layer: int) -> None:
    """The position in the file, if this layer is the one next to it."""
    if found.own is not None:
        text = "position in the problem" + ("" if found.own.feasible else ", no posture there")
        _mark(axes, canvas, found.own.position, layer, text, marker="X", color=VERMILLION, mec="white", ms=12)


def _mark(axes: Axes, canvas: Canvas, point: Array, layer: int, label: str, **look: Any) -> None:
    """A mark at a point (3,) [m, world frame], where this layer is the nearest to it and the picture shows it."""
    (u, v, w), levels = canvas.grid.coordinates(point[None])[0], canvas.grid.values[2]
    here = int(np.argmin(np.abs(levels - w))) == layer and abs(levels[layer] - w) <= canvas.grid.sides[2] / 2 + 1e-9
    if here and _seen(canvas.grid, 1e3 * u, 1e3 * v):
        axes.plot(1e3 * u, 1e3 * v, ls="none", zorder=6, clip_on=False, label=label, **look)


def _seen(grid: Grid, u: float, v: float) -> bool:
    """Whether a point (u, v) [mm] lies in the picture, its edge included."""
    (u0, u1), (v0, v1) = edges_of(grid)
    near = 1e-6 * max(u1 - u0, v1 - v0)  # what is on the edge is seen, whatever rounding says
    return u0 - near <= u <= u1 + near and v0 - near <= v <= v1 + near


def mark_base(axes: Axes, canvas: Canvas, robot: Robot) -> None:
    """The base of the arm as a square, if the picture shows it."""
    reached = walk(robot.base, factor_values(robot.base, []))
    u, v, _ = 1e3 * canvas.grid.coordinates(np.array([reached.position], dtype=float))[0]
    if _seen(canvas.grid, u, v):
        look: Look = {"color": "black", "mec": "white", "ms": 9, "ls": "none", "clip_on": False}
        axes.plot(u, v, "s", zorder=5, label="base of the arm", **look)  # whole on the edge, too


def mark_direction(axes: Axes, grid: Grid, direction: Array) -> None:
    """The direction of the task as an arrow in a corner; nothing where it is not in the plane of the picture.

    Args:
        direction: (3,) unit vector, world frame.
    """
    along = grid.axes[:2] @ direction
    if np.linalg.norm(along) < 0.999:
        return
    (u0, u1), (v0, v1) = edges_of(grid)
    length = _ARROW_SHARE * min(u1 - u0, v1 - v0)
    start = np.array([u1, v1]) - 0.06 * min(u1 - u0, v1 - v0) - length * np.clip(along, 0, 1)
    arrow = {"arrowstyle": "-|>", "color": "black", "lw": 2, "shrinkA": 0, "shrinkB": 0}
    end = start + length * along
    axes.annotate("", (end[0], end[1]), (start[0], start[1]), arrowprops=arrow, zorder=7)
    axes.plot([], [], "-", color="black", lw=2, marker=">", label="direction of the task")


def finish(figure: Figure, panels: Sequence[tuple[Axes, int]], mesh: QuadMesh | None, label: str) -> None:
    """The scale of colours, and one legend for all panels."""
    from matplotlib.ticker import MaxNLocator

    assert mesh is not None, "there is a panel"
    bar = figure.colorbar(mesh, ax=[axes for axes, _ in panels], aspect=25, ticks=MaxNLocator(7))
    bar.set_label(label)
    bar.outline.set_visible(False)
    legend_below(figure)


def plot_line(grid: Grid, label: str, values: Array) -> Figure:
    """Lengths (U,) [m] along a line of targets; stretches without a posture are hatched.

    Args:
        label: what the lengths are, without the unit.
        values: (U,) [m], NaN where there is no posture.
    """
    unit, scale = length_unit([float(np.nanmax(values))])
    figure = new_figure(3.8)
    axes = figure.add_subplot()
    axes.plot(1e3 * grid.values[0], scale * values, "o-", ms=4, color=BLUE)
    (left, right), _ = edges_of(grid)
    step, nowhere = (right - left) / len(values), np.flatnonzero(~np.isfinite(values))
    for k in nowhere:
        name = "no posture" if k == nowhere[0] else None
        ends = left + k * step, left + (k + 1) * step
        axes.axvspan(*ends, facecolor="#EFEFEF", hatch="////", edgecolor=LIGHT, lw=0, label=name)
    axes.set(xlabel=f"{line_words(grid.axes[0])} [mm]", ylabel=f"{label} [{unit}]", xlim=(left, right))
    axes.set_ylim(bottom=0)
    if len(nowhere):
        legend_below(figure)
    return figure
