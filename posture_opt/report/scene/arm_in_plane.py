"""A planar arm: outlines of its links, the obstacles, target and direction in its plane."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array, turn_of
from posture_opt.report.page.colours import BLUE, CLEARANCE_COLOUR, GREY, ORANGE, VERMILLION
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import WIDTH, Look, legend_below
from posture_opt.report.scene.arm_solids import Solid
from posture_opt.report.text.words import line_words
from posture_opt.statements.notation import stated_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.report.scene.arm_geometry import ArmGeometry, TargetGeometry

APART = 0.1  # mm: from there on the target is marked next to the tool point
ARROW = 0.3  # of the arm's extent
_MIN_WIDTH_SHARE = 1e-3  # of the extent: what is thinner is drawn as a line
_LINK_LOOK = {"facecolor": "#D3DBE2", "edgecolor": GREY, "lw": 1.0}
_ROLE_LOOKS: dict[str, Look] = {
    "base": {"facecolor": "#3C4146", "edgecolor": "black", "lw": 1.0, "zorder": 2.0, "label": "base"},
    "link": {**_LINK_LOOK, "zorder": 2.5, "label": "links"},
    "tool": {"facecolor": "#53585E", "edgecolor": "black", "lw": 1.0, "zorder": 2.6, "label": "tool"},
    "obstacle": {"facecolor": "#F2DFCA", "edgecolor": GREY, "hatch": "//", "lw": 1.0, "zorder": 1.5},
}


def draw_in_plane(
    geometry: ArmGeometry, basis: Array, ghosts: Sequence[Solid] = (), way: Array | None = None
) -> Figure:
    """The arm seen along the normal of its plane.

    Axes are coordinates of the plane [mm]. The arm is true to scale; ellipse and clearance of the hole are enlarged by
    the factor in the legend, both alike.

    Args:
        geometry: of a planar arm.
        basis: (2, 3) the axes of the plane, world.
        ghosts: other postures, drawn faintly.
        way: (k, 3) the tool's path [m].
    """
    figure = new_figure(5.0)
    axes: Axes = figure.add_subplot()
    B = 1e3 * basis
    seen = _bodies(axes, geometry, ghosts, B) + _region(axes, geometry, B)
    tool = B @ geometry.tool_point
    joints = np.array([joint.middle for joint in geometry.joints]) @ B.T
    axes.plot(*joints.T, "o", color="white", mec=BLUE, mew=2.5, ms=10, zorder=4, label="joints")
    if way is not None:
        seen.append(way @ B.T)
        axes.plot(*seen[-1].T, color=VERMILLION, lw=1.6, zorder=3, label="path of the tool point")
    axes.plot(*tool, "o", color="black", mec="white", ms=7, zorder=6, ls="none", label="tool point")
    if geometry.target is not None:
        seen += _target(axes, geometry.target, geometry, B)
    if geometry.direction is not None:
        seen += _direction(axes, B @ geometry.direction, tool, 1e3 * geometry.extent)
    _limits(figure, axes, np.vstack(seen))
    axes.set(xlabel=f"{line_words(basis[0])} [mm]", ylabel=f"{line_words(basis[1])} [mm]", aspect="equal")
    legend_below(figure)
    return figure


def _bodies(axes: Axes, geometry: ArmGeometry, ghosts: Sequence[Solid], B: Array) -> list[Array]:
    """Draws the outlines of all solids; the points that must be seen: those of the arm, and of whole obstacles.

    Args:
        B: (2, 3) axes of the plane times 1000: from m to mm of the picture. What is thinner than a thousandth of
            the arm is drawn as a line.
    """
    seen, size = [], 1e3 * geometry.extent
    labels: set[str] = set()
    for solid in _sides(ghosts):
        outline = hull(solid.faces.reshape(-1, 3) @ B.T)
        axes.fill(
            *outline.T,
            facecolor="none",
            edgecolor=GREY,
            lw=0.8,
            ls="--",
            zorder=2,
            label=_once("other points of the path", labels),
        )
        seen.append(outline)
    for solid in (*_sides(geometry.obstacles), *_sides(geometry.solids)):
        outline = hull(solid.faces.reshape(-1, 3) @ B.T)
        look = dict(_ROLE_LOOKS[solid.role])
        label = solid.name if solid.role == "obstacle" else look.pop("label")
        if _narrow(outline) < _MIN_WIDTH_SHARE * size:
            axes.plot(*outline.T, color=look["facecolor"], lw=4, zorder=look["zorder"], label=_once(label, labels))
        else:
            axes.fill(*outline.T, **look, label=_once(label, labels))
        if solid.role != "obstacle" or np.ptp(outline, axis=0).max() < size:
            seen.append(outline)
    return seen


def _sides(solids: Iterable[Solid]) -> list[Solid]:
    """Without the bodies of the joints, which are seen end on and marked as circles."""
    return [solid for solid in solids if solid.role in _ROLE_LOOKS]


def _once(label: str, said: set[str]) -> str | None:
    """A label the first time, None afterwards: the legend names each thing once."""
    if label in said:
        return None
    said.add(label)
    return label


def _narrow(outline: Array) -> float:
    """The least width of points (k, 2), along their principal axes."""
    return float(np.linalg.svd(outline - outline.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(outline)))


def hull(points: Array) -> Array:
    """The corners (k, 2) of the convex hull of points (n, 2), counter-clockwise (A. M. Andrew, 1979).

    >>> hull(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]])).tolist()
    [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    """
    ordered = np.unique(points.round(9), axis=0)
    if len(ordered) < 3:
        return ordered

    def chain(rows: Array) -> list[Array]:
        kept: list[Array] = []
        for row in rows:
            while len(kept) > 1 and turn_of(kept[-2], kept[-1], row) <= 0:
                kept.pop()
            kept.append(row)
        return kept[:-1]

    return np.array([*chain(ordered), *chain(ordered[::-1])])


def _region(axes: Axes, geometry: ArmGeometry, B: Array) -> list[Array]:
    """The enlarged 95 % ellipse; its points (k, 2) [mm] must be seen."""
    boundary: Array = geometry.region.surface(60)[-1] @ B.T
    axes.fill(*boundary.T, facecolor=ORANGE, alpha=0.35, zorder=3)
    axes.fill(*boundary.T, facecolor="none", edgecolor=VERMILLION, lw=1.8, zorder=5, label=geometry.region.label)
    return [boundary]


def _target(axes: Axes, target: TargetGeometry, geometry: ArmGeometry, B: Array) -> list[Array]:
    """Draws region or point, and the clearance on the scale of the ellipse; the points that must be seen."""
    seen = []
    if target.kind == "region":
        low, high = B @ target.lower, B @ target.upper
        corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
        axes.plot(*corners.T, ":", color="black", lw=1.4, zorder=1, label="box for the target")
        seen.append(corners)
    point = B @ (target.lower if target.kind == "point" else geometry.tool_point)
    if target.kind == "point" and np.linalg.norm(point - B @ geometry.tool_point) > APART:
        axes.plot(*point, "X", color=VERMILLION, mec="white", ms=11, zorder=6, ls="none", label="target, not reached")
        seen.append(point[None])
    if target.clearance and np.linalg.norm(B @ target.direction) > 1e-6:
        seen.append(_hole(axes, target, geometry, B, point))
    return seen


def _hole(axes: Axes, target: TargetGeometry, geometry: ArmGeometry, B: Array, point: Array) -> Array:
    """The walls of the hole on both sides of the direction, as far apart as the ellipse is enlarged.

    Args:
        point: (2,) the target [mm] in the plane. Returns the ends of both walls (4, 2) [mm].
    """
    assert target.clearance is not None
    factor, along = geometry.region.factor, B @ target.direction / 1e3
    aside = 1e3 * factor * target.clearance * np.array([-along[1], along[0]])
    deep = 0.5 * ARROW * 1e3 * geometry.extent * along
    enlarged = f", enlarged {factor:g}\N{MULTIPLICATION SIGN}" if factor > 1 else ""
    text = f"hole: clearance {stated_length(target.clearance)}{enlarged}"
    walls = [np.array([point + sign * aside, point + sign * aside + deep]) for sign in (1, -1)]
    for k, wall in enumerate(walls):
        axes.plot(*wall.T, "--", color=CLEARANCE_COLOUR, lw=2.2, zorder=4, label=None if k else text)
    return np.vstack(walls)


def _direction(axes: Axes, along: Array, tool: Array, extent: float) -> list[Array]:
    """Draws the direction (2,), where it is not that of the view; the point that must be seen."""
    if np.linalg.norm(along) < 1e-3:
        return []
    end = tool + ARROW * extent * along / 1e3
    arrow = {"arrowstyle": "-|>", "color": "black", "lw": 2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (end[0], end[1]), (tool[0], tool[1]), arrowprops=arrow, zorder=7)
    axes.plot([], [], "-", color="black", lw=2, marker=">", label="direction of the task")
    return [end[None]]


def _limits(figure: Figure, axes: Axes, points: Array) -> None:
    """Sets limits about points (k, 2) [mm] with a margin of 6 %, and the height of the figure that suits them."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.06 * max(float((high - low).max()), 1.0)
    # As high as it must be for its width: no white bands above and below an arm that lies flat.
    width, height = high - low + 2 * margin
    figure.set_size_inches(WIDTH, min(max((WIDTH - 1.0) * height / width + 1.1, 3.0), 6.0))
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
