"""An arm in space: the shaded picture with its marks, and a label with a leader line at everything that matters.

The picture is orthographic and true to scale, except for region and clearance, which are enlarged by one factor.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.numerics import Array, Mask
from posture_opt.report.page.colours import CLEARANCE_COLOUR, GREY, VERMILLION
from posture_opt.report.page.new_figure import new_figure
from posture_opt.report.page.style import FONT, WIDTH, Look
from posture_opt.report.scene.arm_in_plane import APART, ARROW
from posture_opt.report.scene.arm_solids import Solid
from posture_opt.report.scene.camera import Camera, best_camera
from posture_opt.report.scene.label_placement import Label, PlacedLabel, placed
from posture_opt.report.scene.scene_image import SceneImage, grid_step
from posture_opt.statements.notation import stated_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt.report.scene.arm_geometry import ArmGeometry

_MARGINS = 0.2, 0.08  # of width and height: for labels
_HEIGHTS = 4.2, 6.4  # inch
_MAX_RING_SHARE = 0.3  # of the extent: a clearance that is larger on the scale of the region is named, not drawn
_TRIAD_LENGTH_INCH = 0.32  # inch: length of the axes in the corner
_CORNER_SIZE_INCH = np.array([2.0, 0.85])  # inch: room for axes and scale
_TITLE_HEIGHT_INCH = 0.3  # inch
_MAX_NAME = 25  # letters of a name in the column of joint values
_COLUMN, _ROW = 1.75, 0.175  # inch: width of the column of joint values, and of its lines the height
_ARM_SHIFT_SHARE = 0.09  # of the width: so far the arm is left of the middle, to leave room for that


@dataclass(frozen=True, eq=False)
class SceneMark:
    """What is drawn over the picture.

    Args:
        points: a line (k, 3) or a point (1, 3) [m], world frame.
        look: of the line, as matplotlib has it.
        text: of its label; empty where it has none.
    """

    points: Array
    look: Look
    text: str = ""

    @property
    def anchor(self) -> Array:
        """(3,) the point that a label leads to."""
        return np.asarray(self.points[len(self.points) // 2 if len(self.points) > 2 else -1])


def draw_in_space(
    geometry: ArmGeometry,
    title: str,
    posture: Sequence[tuple[str, str]] = (),
    ghosts: Sequence[Solid] = (),
    way: Array | None = None,
) -> Figure:
    """The arm, the region about its tool point, the target and the obstacles.

    Drawn in this order: the shaded picture, marks over it, the title, the column of joint values, axes and scale in
    the emptier corner, and labels where they cover nothing.

    Args:
        geometry: of the posture.
        title: which arm it is; ``posture`` its joints with their values, listed in a column next to it.
        ghosts: other postures, drawn faintly; ``way`` (k, 3) the tool's path [m].
    """
    marks = [*_target_marks(geometry), *_direction_marks(geometry), *_tool_marks(geometry), *_way_marks(way)]
    camera, height = _framed(geometry, marks, ghosts)
    scene = SceneImage(geometry, camera, height, tuple(ghosts))
    figure = new_figure(height)
    figure.set_layout_engine("none")  # the picture fills it
    axes: Axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    (left, low), (wide, high) = camera.lower, camera.size
    axes.imshow(scene.pixels, extent=(left, left + wide, low, low + high), origin="lower", interpolation="lanczos")
    axes.set(xlim=(left, left + wide), ylim=(low, low + high))
    axes.set_axis_off()
    for mark in marks:
        axes.plot(*camera.project(mark.points)[:, :2].T, **mark.look)
    _arrow(axes, camera, geometry)
    taken = scene.arm_mask.copy()
    taken[-int(_TITLE_HEIGHT_INCH / height * len(taken)) :] = True
    axes.text(6 / 72 / WIDTH, 1 - 6 / 72 / height, title, transform=axes.transAxes, va="top", weight="bold", zorder=8)
    _cover(taken, marks, camera, geometry)
    _column(axes, posture, taken, height)
    _corner(axes, camera, geometry, taken, height)
    _labels(axes, _named(geometry, scene, marks), taken, camera, height)
    return figure


def label_boxes(figure: Figure) -> list[PlacedLabel]:
    """The labels of a figure of an arm in space, as they were placed."""
    return [getattr(text, "placed_label") for text in figure.axes[0].texts if hasattr(text, "placed_label")]  # noqa: B009


def _framed(geometry: ArmGeometry, marks: Sequence[SceneMark], ghosts: Sequence[Solid]) -> tuple[Camera, float]:
    """The view, and the height of the figure that suits it [inch].

    In the picture are the arm, the region, all marks, and obstacles that are smaller than the arm.
    """
    whole = [o.faces for o in geometry.obstacles if np.ptp(o.faces.reshape(-1, 3), axis=0).max() < geometry.extent]
    seen = [geometry.points, geometry.region.surface().reshape(-1, 3), *(mark.points for mark in marks)]
    seen += [faces.reshape(-1, 3) for faces in whole] + [ghost.faces.reshape(-1, 3) for ghost in ghosts]
    if geometry.direction is not None:
        seen.append((geometry.tool_point + ARROW * geometry.extent * geometry.direction)[None])
    points, camera = np.concatenate(seen), best_camera(geometry)
    wide, high = np.ptp(camera.project(points)[:, :2], axis=0) / (1 - 2 * np.array(_MARGINS))
    height = float(np.clip(WIDTH * high / wide, *_HEIGHTS))
    camera = camera.framing(points, WIDTH / height, _MARGINS)
    return replace(camera, lower=camera.lower + np.array([_ARM_SHIFT_SHARE, 0.0]) * camera.size), height


def _tool_marks(geometry: ArmGeometry) -> list[SceneMark]:
    """The nominal tool point."""
    look = {"marker": "o", "color": "black", "mec": "white", "ms": 6, "zorder": 5}
    return [SceneMark(geometry.tool_point[None], look, "tool point")]


def _direction_marks(geometry: ArmGeometry) -> list[SceneMark]:
    """The clearance of the hole about the target, enlarged as the region is, so that both can be compared.

    Left out where it would be larger than 30 % of the arm.
    """
    target, factor = geometry.target, geometry.region.factor
    if target is None or not target.clearance or factor * target.clearance > _MAX_RING_SHARE * geometry.extent:
        return []
    d = target.direction
    side = np.cross(d, np.eye(3)[np.argmin(np.abs(d))])
    side /= np.linalg.norm(side)
    turn = np.linspace(0, 2 * math.pi, 73)[:, None]
    ring = np.cos(turn) * side + np.sin(turn) * np.cross(d, side)
    center = target.lower if target.kind == "point" else geometry.tool_point
    text = f"hole, its clearance of {stated_length(target.clearance)}\nenlarged {factor:g}\N{MULTIPLICATION SIGN} too"
    return [
        SceneMark(
            center + factor * target.clearance * ring,
            {"color": CLEARANCE_COLOUR, "lw": 2, "ls": "--", "zorder": 4},
            text,
        )
    ]


def _target_marks(geometry: ArmGeometry) -> list[SceneMark]:
    """The box for the target, or a target that the tool point does not reach; nothing where it does."""
    target = geometry.target
    if target is None:
        return []
    if target.kind == "region":
        corners = np.array(list(itertools.product(*zip(target.lower, target.upper, strict=True))))
        pairs = itertools.combinations(corners, 2)
        edges = [np.array(pair) for pair in pairs if np.count_nonzero(np.abs(pair[0] - pair[1]) > 1e-9) == 1]
        look = {"color": GREY, "lw": 1.0, "ls": ":", "zorder": 3}
        return [SceneMark(edge, look, "" if k else "box for the target") for k, edge in enumerate(edges)]
    if target.kind == "point" and np.linalg.norm(target.lower - geometry.tool_point) > 1e-3 * APART:
        look = {"marker": "X", "color": VERMILLION, "mec": "white", "ms": 11, "zorder": 6}
        return [SceneMark(target.lower[None], look, "target, not reached")]
    return []


def _way_marks(way: Array | None) -> list[SceneMark]:
    """The path (k, 3) [m] of the tool point."""
    return (
        [] if way is None else [SceneMark(way, {"color": VERMILLION, "lw": 1.6, "zorder": 3}, "path of the tool point")]
    )


def _arrow(axes: Axes, camera: Camera, geometry: ArmGeometry) -> None:
    """The direction of the task at the tool point, of 30 % of the arm's extent."""
    if geometry.direction is None:
        return
    ends = geometry.tool_point + ARROW * geometry.extent * np.outer([0.0, 1.0], geometry.direction)
    start, end = camera.project(ends)[:, :2]
    arrow = {"arrowstyle": "-|>", "color": "black", "lw": 2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=arrow, zorder=4)


def _named(geometry: ArmGeometry, scene: SceneImage, marks: Sequence[SceneMark]) -> list[tuple[str, Array]]:
    """Every text with the point (2,) of the picture that it names [m].

    The label of the region leads to its side that is farthest from the arm.
    """
    camera = scene.camera
    named = [(mark.text, camera.project(mark.anchor[None])[0, :2]) for mark in marks if mark.text]
    rim = camera.project(geometry.region.surface(24).reshape(-1, 3))[:, :2]
    arm = camera.project(geometry.points)[:, :2].mean(axis=0)
    middle = rim.mean(axis=0)
    outward = rim[np.argmax((rim - middle) @ (middle - arm))]
    named.append((geometry.region.label.replace(", ", ",\n"), 0.5 * (outward + middle)))
    if geometry.direction is not None:
        end = geometry.tool_point + 0.8 * ARROW * geometry.extent * geometry.direction
        named.append(("direction of the task", camera.project(end[None])[0, :2]))
    return named + scene.obstacle_anchors()


def _labels(axes: Axes, named: Sequence[tuple[str, Array]], taken: Mask, camera: Camera, height: float) -> None:
    """Places the labels and draws them with their leader lines.

    Args:
        named: texts with the points (2,) [m] that they name.
        taken: (H, W) where nothing may be covered.
        height: of the figure [inch].
    """
    size, labels = 72 * np.array([WIDTH, height]), []
    extents = _extents(axes, [text for text, _ in named])
    for (text, point), extent in zip(named, extents, strict=True):
        labels.append(Label(text, (point - camera.lower) / camera.size * size, 72 * extent))
    for label in placed(labels, taken, size):
        axes.annotate(
            "", tuple(label.label.anchor), tuple(label.end), xycoords="axes points", textcoords="axes points", zorder=7,
            arrowprops={"arrowstyle": "-", "color": "#404040", "lw": 0.8, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
        x, y = label.middle / size
        shown: Any = axes.text(x, y, label.label.text, transform=axes.transAxes, ha="center", va="center")
        shown.set(zorder=8, linespacing=1.1)
        shown.set_bbox({"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1})
        shown.placed_label = label


def _extents(axes: Axes, texts: Sequence[str]) -> list[Array]:
    """Width and height (2,) of each text in the figure [inch]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure: Any = axes.figure
    renderer: Any = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    found = []
    for text in texts:
        drawn = axes.text(0, 0, text)
        box = drawn.get_window_extent(renderer)
        drawn.remove()
        found.append(np.array([box.width, box.height]) / figure.dpi)
    return found


def _widths(axes: Axes, texts: Sequence[str]) -> list[float]:
    """Width of each text in the figure [inch]."""
    return [float(extent[0]) for extent in _extents(axes, texts)]


def shortened(name: str, most: int) -> str:
    """A name of at most so many letters: of a longer one beginning and end, which number joints of one arm.

    >>> shortened("left_arm_manipulator_joint_1", 15)
    'left_ar…joint_1'
    """
    return name if len(name) <= most else f"{name[: most // 2]}…{name[-(most // 2) :]}"


def _column(axes: Axes, posture: Sequence[tuple[str, str]], taken: Mask, height: float) -> None:
    """The joint values at the right edge, from the top; marked as taken."""
    if not posture:
        return
    rows = [("posture", ""), *((shortened(name, _MAX_NAME), value) for name, value in posture)]
    widths = _widths(axes, [f"{name}  {value}" for name, value in rows])
    column = max(_COLUMN, max(widths) + 0.2)
    for k, (name, value) in enumerate(rows):
        at = 1 - (0.08 + _ROW * k) / height
        look: Look = {"transform": axes.transAxes, "va": "top", "zorder": 8}
        axes.text(1 - column / WIDTH, at, name, weight="normal" if k else "bold", **look)
        axes.text(1 - 0.1 / WIDTH, at, value, ha="right", **look)
    high, wide = taken.shape
    taken[-int((0.15 + _ROW * len(rows)) / height * high) :, -int((column + 0.1) / WIDTH * wide) :] = True


def _cover(taken: Mask, marks: Sequence[SceneMark], camera: Camera, geometry: ArmGeometry) -> None:
    """Marks the places of lines and of the arrow as taken, so that no label is put on them.

    Args:
        taken: (H, W), changed in place.
    """
    lines = [mark.points for mark in marks if len(mark.points) > 1]
    if geometry.direction is not None:
        lines.append(
            geometry.tool_point + ARROW * geometry.extent * np.linspace(0, 1, 60)[:, None] * geometry.direction
        )
    high, wide = taken.shape
    for line in lines:
        at = (camera.project(line)[:, :2] - camera.lower) / camera.size * [wide, high]
        for column, row in at.astype(int).tolist():
            taken[max(row - 3, 0) : row + 4, max(column - 3, 0) : column + 4] = True


def _corner(axes: Axes, camera: Camera, geometry: ArmGeometry, taken: Mask, height: float) -> None:
    """The axes of the world and the scale, in the lower corner that is emptier; marked as taken.

    An axis that points nearly at the viewer has no letter; the scale is a round length, about a fifth of the arm.
    """
    rows, columns = (_CORNER_SIZE_INCH[::-1] / [height, WIDTH] * taken.shape).astype(int)
    left = taken[:rows, :columns].sum() <= taken[:rows, -columns:].sum()
    taken[:rows, slice(0, columns) if left else slice(-columns, None)] = True
    at = np.array([0.55 if left else WIDTH - 1.7, 0.42])
    inch = camera.size / [WIDTH, height]
    for axis, name in zip(np.eye(3), "xyz", strict=True):
        way = camera.project(axis[None])[0, :2]
        end = at + _TRIAD_LENGTH_INCH * way
        arrow = {"arrowstyle": "-|>", "color": "black", "lw": 1.1, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7}
        axes.annotate("", tuple(camera.lower + end * inch), tuple(camera.lower + at * inch), arrowprops=arrow, zorder=7)
        beyond = at + (_TRIAD_LENGTH_INCH + FONT / 100) * way
        if np.linalg.norm(way) > 0.25:
            x, y = camera.lower + beyond * inch
            axes.text(x, y, name, ha="center", va="center", zorder=8)
    step = grid_step(geometry.extent)
    text = f"{1e3 * step:g} mm"
    start = camera.lower + (at + np.array([0.6, -0.2])) * inch
    axes.plot([start[0], start[0] + step], [start[1]] * 2, color="black", lw=2, solid_capstyle="butt", zorder=7)
    axes.text(start[0] + step / 2, start[1] + 0.06 * inch[1], text, ha="center", va="bottom", zorder=8)
