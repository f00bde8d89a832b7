"""Maps over the targets: standard deviation, bias, 95 % radius; hatched without a posture, measured rows as dots.

Axes are two coordinates of the grid [mm], a panel a layer of the third; all panels share one scale of colours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle, pairwise, product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from posture_opt.model.chain import factor_values, walk
from posture_opt.numerics import Array
from posture_opt.report.page.colours import BLUE, COLOUR_MAP, LIGHT, ORANGE, VERMILLION
from posture_opt.report.page.style import WIDTH, Look, legend, new_axes, new_figure, styled
from posture_opt.report.text.words import PARTS, line_words
from posture_opt.selection.maps.map_search import SELF_COLLISION
from posture_opt.statements.notation import length_unit
from posture_opt.units import fixed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    from posture_opt import AccuracyMap, TargetMap
    from posture_opt.selection.maps.grid_layout import Grid

_PANELS_WIDTH_INCH = WIDTH - 1.6  # the rest is the scale of colours with its numbers
_REASONS = {"not reached": "out of reach", "requirement not met": "a requirement is not met"}
_LOOKS = (
    ("#E4E4E4", "////"), ("#F6F6F6", "...."), ("#F3C9C4", ""), ("#DCC9E8", "\\\\"), ("#CBE6D3", "xx"),
    ("#FBE3BC", "--"),
)  # fmt: skip
_OUTLINE_COLOUR = "#7A4A12"
_FAR = 2.0  # m: so far around the targets, planes and other endless obstacles are drawn


@dataclass(frozen=True)
class Canvas:
    """What all panels of a map share; ``base`` (2,) [mm]."""

    grid: Grid
    base: Array
    norm: Normalize
    unit: str
    scale: float

    @classmethod
    def of(cls, found: TargetMap, values: Array, others: Array | None = None) -> Canvas:
        """A scale over ``values`` (N,) [m] and, where given, other lengths that are drawn with the same colours."""
        seen = values[np.isfinite(values)]
        if others is not None and len(others):
            # One gross outlier must not wash out all the rest.
            seen = np.concatenate([seen, others[others <= np.quantile(others, 0.95)]])
        low, high = float(seen.min()), float(seen.max())
        unit, scale = length_unit([high])
        if high - low < 1e-3 * high:
            low, high = 0.98 * low, 1.02 * high
        from matplotlib.colors import Normalize

        robot, grid = found.optimisation_problem.robot, found.grid
        origin = np.array([walk(robot.base, factor_values(robot.base, [])).position], dtype=float)
        return cls(
            grid, 1e3 * grid.coordinates(origin)[0, :2], Normalize(scale * low, scale * high), unit, scale
        )  # fmt: skip

    @property
    def limits(self) -> tuple[Array, Array]:
        """(2,) lower left and upper right of the picture [mm]: all cells, and the base where that is near."""
        low, high = np.array(edges_of(self.grid)).T
        # A base is drawn up to half the picture outside of it.
        if np.any(np.abs(self.base - (low + high) / 2) > high - low):
            return low, high
        margin = 0.04 * (high - low)
        return np.minimum(low, self.base - margin), np.maximum(high, self.base + margin)

    def layers(self, values: NDArray[Any]) -> NDArray[Any]:
        """(W, V, U, ...) an array over all targets by layers."""
        return values.reshape(*self.grid.shape, *values.shape[1:])


@styled
def plot_target_map(found: TargetMap) -> Figure:
    """The smallest spread that a posture gives, over the targets of the grid. Colours are the standard deviation of the
    part that counts [µm or mm]; cells without a posture have the colour of what fails there. Base, obstacles and the
    box for the target are outlined."""
    label = f"standard deviation {PARTS[found.within]}"
    if found.grid.shape[1] == 1 and found.grid.shape[0] == 1:
        return plot_line(found.grid, label, found.sigma)
    canvas = Canvas.of(found, found.sigma)
    figure, panels = new_panels(canvas)
    for axes, layer in panels:
        mesh = draw_layer(axes, canvas, found, found.sigma, layer)
        _mark(axes, canvas, found.best.position, layer, "best place", marker="*", color=ORANGE, mec="black", ms=18)
    finish(figure, panels, mesh, f"{label} [{canvas.unit}]")
    return figure


def draw_layer(axes: Axes, canvas: Canvas, found: TargetMap, values: Array, layer: int) -> QuadMesh:
    """One layer of values (N,) [m] with all that a map shows of the problem; the cells serve the scale of colours."""
    shown = np.ma.masked_invalid(canvas.scale * canvas.layers(values)[layer])
    mesh = axes.pcolormesh(*_corners(canvas.grid), shown, cmap=COLOUR_MAP, norm=canvas.norm, zorder=1)
    mesh.set_rasterized(True)  # as paths, hairlines show between the cells
    _colour_failing(axes, canvas, found, layer)
    _outline_surroundings(axes, canvas, found)
    if found.own is not None:
        text = "position in the problem" + ("" if found.own.feasible else ", no posture there")
        _mark(axes, canvas, found.own.position, layer, text, marker="X", color=VERMILLION, mec="white", ms=12)
    mark_direction(axes, canvas.grid, found.target.direction)
    return mesh


def new_panels(canvas: Canvas) -> tuple[Figure, list[tuple[Axes, int]]]:
    """A figure with axes for each layer that is shown, and the numbers of these layers."""
    grid, count = canvas.grid, canvas.grid.shape[0]
    # A turned grid has no coordinate axes: its labels are offsets from the middle.
    names, off = [line_words(e) for e in grid.axes], "" if grid.aligned else ", off the middle"
    shown = np.unique(np.linspace(0, count - 1, min(count, 9)).round().astype(int)).tolist()
    columns = min(len(shown), 3 if len(shown) not in (1, 2, 4) else 2)
    rows = math.ceil(len(shown) / columns)
    wide, tall = np.subtract(*canvas.limits[::-1])
    # As high as the panels are for their width: no white bands, and a scale of colours of the same height.
    height = _PANELS_WIDTH_INCH / columns * min(max(tall / wide, 0.3), 1.4)
    figure = new_figure(rows * (height + 0.25) + 1.0)
    panels = []
    for k, layer in enumerate(shown):
        axes = figure.add_subplot(rows, columns, k + 1)
        (u0, v0), (u1, v1) = canvas.limits
        axes.set(xlim=(u0, u1), ylim=(v0, v1), autoscale_on=False, aspect="equal")
        # Labels at the left and below the lowest only: the panels get their room.
        left, lowest = k % columns == 0, k + columns >= len(shown)
        axes.tick_params(labelleft=left, labelbottom=lowest)
        axes.set(xlabel=f"{names[0]}{off} [mm]" if lowest else "", ylabel=f"{names[1]}{off} [mm]" if left else "")
        if grid.aligned and (len(grid.values[2]) > 1 or abs(grid.values[2][0]) > 1e-9):
            axes.set_title(f"{names[2]} = {fixed(1e3 * grid.values[2][layer], 1)} mm")
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        axes.locator_params(nbins=5 if columns > 1 else 8)
        panels.append((axes, layer))
    return figure, panels


def edges_of(grid: Grid) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ends of the picture along u and v [mm]: half a cell beyond the outer targets."""
    (u, v, _), (du, dv, _) = grid.values, grid.sides
    return (1e3 * (u[0] - du / 2), 1e3 * (u[-1] + du / 2)), (1e3 * (v[0] - dv / 2), 1e3 * (v[-1] + dv / 2))


def _corners(grid: Grid) -> tuple[Array, Array]:
    """(U + 1,) and (V + 1,) the edges of the cells [mm]."""
    (u0, u1), (v0, v1) = edges_of(grid)
    return np.linspace(u0, u1, len(grid.values[0]) + 1), np.linspace(v0, v1, len(grid.values[1]) + 1)


def _colour_failing(axes: Axes, canvas: Canvas, found: TargetMap, layer: int) -> None:
    from matplotlib.collections import PolyCollection

    u, v = _corners(canvas.grid)
    reasons = np.array(["" if p.feasible else p.blocked_by or _REASONS[p.status] for p in found.map_points])
    looks = dict(zip([*_REASONS.values(), *sorted({*reasons} - {"", *_REASONS.values()})], cycle(_LOOKS)))
    for reason, (colour, hatch) in looks.items():
        cells = [
            [(u[i], v[k]), (u[i + 1], v[k]), (u[i + 1], v[k + 1]), (u[i], v[k + 1])]
            for k, i in np.argwhere(canvas.layers(reasons)[layer] == reason).tolist()
        ]
        if cells:
            look: Look = {"facecolor": colour, "edgecolor": "#A0A0A0", "hatch": hatch, "lw": 0}
            label = reason if reason in (*_REASONS.values(), SELF_COLLISION) else f"{reason} in the way"
            axes.add_collection(PolyCollection(cells, zorder=1, label=label, **look))


def _outline_surroundings(axes: Axes, canvas: Canvas, found: TargetMap) -> None:
    """The outlines of the base, of the obstacles and of the box for the target, as they are seen along the third
    axis."""
    (u0, v0), (u1, v1) = canvas.limits
    for obstacle in found.problem.scene.stated_obstacles:
        points = obstacle.facets(*found.grid.points[[0, -1]] + [[-_FAR], [_FAR]]).reshape(-1, 3)
        outline = _outline(1e3 * canvas.grid.coordinates(points)[:, :2])
        axes.plot(*outline.T, color=_OUTLINE_COLOUR, lw=1.4, zorder=3)
        seen = outline[np.all((outline > [u0, v0]) & (outline < [u1, v1]), axis=1)]
        if len(seen):
            x, y = seen.mean(axis=0)
            axes.text(x, y, obstacle.name, color=_OUTLINE_COLOUR, ha="center", va="center", clip_on=True, zorder=4,
                      bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1})  # fmt: skip
    if found.target.kind == "region":
        corners = np.array(list(product(*zip(found.target.lower, found.target.upper, strict=True))))
        box = _outline(1e3 * canvas.grid.coordinates(corners)[:, :2])
        axes.plot(*box.T, color="black", lw=1.4, ls=":", zorder=3, clip_on=False, label="box for the target")
    low, high = canvas.limits
    if np.all((canvas.base >= low) & (canvas.base <= high)):
        look: Look = {"mfc": "none", "mec": "black", "mew": 1.8, "ms": 11, "clip_on": False, "ls": "none"}
        axes.plot(*canvas.base, "s", zorder=5, label="base of the arm", **look)


def _outline(points: Array) -> Array:
    """The closed convex outline (k, 2) of points (n, 2), densely: the farthest ones in directions of every degree."""
    turn = np.radians(np.arange(361))
    corners = points[np.argmax(points @ np.array([np.cos(turn), np.sin(turn)]), axis=0)]
    return np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(corners) if np.any(a != b)] or [corners])


def _mark(axes: Axes, canvas: Canvas, point: Array, layer: int, label: str, **look: Any) -> None:
    """A mark at a point (3,) [m, world frame], where this layer is the nearest to it and the picture shows it."""
    (u, v, w), levels = canvas.grid.coordinates(point[None])[0], canvas.grid.values[2]
    here = int(np.argmin(np.abs(levels - w))) == layer and abs(levels[layer] - w) <= canvas.grid.sides[2] / 2 + 1e-9
    (u0, u1), (v0, v1) = edges_of(canvas.grid)
    near = 1e-6 * max(u1 - u0, v1 - v0)  # what is on the edge is seen, whatever rounding says
    if here and u0 - near <= 1e3 * u <= u1 + near and v0 - near <= 1e3 * v <= v1 + near:
        axes.plot(1e3 * u, 1e3 * v, ls="none", zorder=6, clip_on=False, label=label, **look)


def mark_direction(axes: Axes, grid: Grid, direction: Array) -> None:
    """The direction of the task as an arrow in a corner; nothing where it is not in the plane of the picture;
    ``direction`` (3,)."""
    along = grid.axes[:2] @ direction
    if np.linalg.norm(along) < 0.999:
        return
    (u0, u1), (v0, v1) = edges_of(grid)
    length = 0.14 * min(u1 - u0, v1 - v0)
    start = np.array([u1, v1]) - 0.06 * min(u1 - u0, v1 - v0) - length * np.clip(along, 0, 1)
    arrow = {"arrowstyle": "-|>", "color": "black", "lw": 2, "shrinkA": 0, "shrinkB": 0}
    end = start + length * along
    axes.annotate("", (end[0], end[1]), (start[0], start[1]), arrowprops=arrow, zorder=7)
    axes.plot([], [], "-", color="black", lw=2, marker=">", label="direction of the task")


def finish(figure: Figure, panels: Sequence[tuple[Axes, int]], mesh: QuadMesh, label: str) -> None:
    """The scale of colours, and one legend for all panels."""
    from matplotlib.ticker import MaxNLocator

    bar = figure.colorbar(mesh, ax=[axes for axes, _ in panels], aspect=25, ticks=MaxNLocator(7))
    bar.set_label(label)
    bar.outline.set_visible(False)
    legend(figure)


def plot_line(grid: Grid, label: str, values: Array) -> Figure:
    """Lengths (U,) [m] along a line of targets; stretches without a posture are hatched; ``values`` (U,) [m]."""
    unit, scale = length_unit([float(np.nanmax(values))])
    figure, axes = new_axes(3.8)
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
        legend(figure)
    return figure


@styled
def plot_bias(found: AccuracyMap) -> Figure:
    """How far off the target the arm lands without its corrections [mm], and which way. Colours are the length of the
    bias; arrows its part in the plane of the figure, all enlarged by the factor in the legend. Dots are measured rows,
    in the same colours: where a dot vanishes in its cell, the prediction is true there."""
    measured = None if found.measured is None else found.measured.uncorrected
    return _plot(found, found.distance, "mean distance from the target, uncorrected", measured, arrows=True)


@styled
def plot_spread_map(found: AccuracyMap) -> Figure:
    """The distance from its mean that the tool point keeps with 95 % probability [mm], over the targets. Axes are two
    coordinates of the grid [mm], a panel a layer. Dots are measured rows in the same colours, with the corrections: 95
    % of them should be no brighter than their cell."""
    measured = None if found.measured is None else found.measured.corrected
    return _plot(found, found.radius95, "distance from its mean, 95 % probability", measured, arrows=False)


def _plot(found: AccuracyMap, values: Array, label: str, measured: Array | None, *, arrows: bool) -> Figure:
    """One of both maps, or a curve where the targets are on a line; ``values`` (N,) [m], ``measured`` (M,) [m]."""
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
    """The part of the bias in the plane of the figure, enlarged alike everywhere."""
    grid = canvas.grid
    inside = canvas.layers(found.bias @ grid.axes[:2].T)[layer]
    longest = float(np.nanmax(np.linalg.norm(found.bias @ grid.axes[:2].T, axis=1)))
    # Below 5 % of the longest, an arrow is a dot.
    if longest <= 0.05 * float(np.nanmax(found.distance)):
        return  # it lies across the figure
    step = max(1, round(max(grid.shape[1:]) / 12))
    cell = 1e3 * min(grid.sides[:2]) * step
    # The longest arrow takes 0.9 of a cell's shorter side.
    enlarged = 0.9 * cell / longest
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
    """Measured rows near this layer, in the colours of the cells; ``lengths`` (M,) [m]."""
    assert found.measured is not None
    measured, grid = found.measured, canvas.grid
    mine = measured.near & (measured.cell // (grid.shape[1] * grid.shape[2]) == layer)
    if mine.any():
        u, v, _ = 1e3 * grid.coordinates(measured.place[mine]).T
        size = float(np.clip(4000 / np.count_nonzero(mine), 12, 45))
        look: Look = {"cmap": COLOUR_MAP, "norm": canvas.norm, "edgecolors": "white", "linewidths": 0.8, "zorder": 5}
        axes.scatter(u, v, c=canvas.scale * lengths[mine], s=size, label="measured", clip_on=False, **look)
