"""The figure of an arm in its posture: the shaded picture, marks over it, and a column with joint values and callouts.

True to scale, except for region and clearance, which are enlarged by one factor. A planar arm is seen along the normal
of its plane, others from the side that shows most.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations, product
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array, Mask, round_below
from posture_opt.report.page.colours import GREY, VERMILLION
from posture_opt.report.page.style import WIDTH, Look, new_figure, styled
from posture_opt.report.scene.arm_geometry import ARROW_SHARE, ArmGeometry
from posture_opt.report.scene.arm_solids import COLOURS, ArmSolids, Solid
from posture_opt.report.scene.shaded_picture import Camera, best_camera, picture_of
from posture_opt.statements.notation import joint_unit
from posture_opt.units import fixed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from posture_opt import Solution, Spread

MAX_CALLOUTS = 3
_COLUMN, _ROW, _EDGE, _SCALE = 2.3, 0.175, 0.12, 0.95  # inch: column, line of it, margin, room for axes and scale
_LETTERS, _LETTER = 30, 0.078  # letters of a line of the column; mean width of one [inch]
_HEIGHTS = 3.4, 6.0  # inch
_LINE: Look = {"color": COLOURS["direction"], "lw": 2, "arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0}


@dataclass(frozen=True, eq=False)
class Stroke:
    """What is drawn over the picture.

    Args:
        points: (k, 3) a point, or lines with NaN between them [m], world.
        look: as matplotlib has it; with an ``arrowstyle``, an arrow.
        text: of its callout, which leads to that of ``ends`` (k, 3) that is nearest to the column.
    """

    points: Array
    look: Look
    text: str
    ends: Array


def draw_arm(
    geometry: ArmGeometry,
    heading: str,
    posture: Sequence[tuple[str, str]] = (),
    ghosts: Sequence[Solid] = (),
    way: Array | None = None,
) -> Figure:
    """The arm, the region about its tool point, the target and the obstacles; ``way`` (k, 3) [m]."""
    marks = marks_of(geometry, way)
    rows = [(line, "") for line in wrap(heading, _LETTERS)]
    rows += [(shortened(name, _LETTERS - 2 - len(value)), value) for name, value in posture]
    camera, right, height = _framed(geometry, marks, ghosts, _SCALE + _ROW * (len(rows) + 2 + 3 * MAX_CALLOUTS))
    size, (pixels, arm, obstacles) = np.array([WIDTH, height]), picture_of(geometry, camera, height, ghosts)
    figure = new_figure(height)
    figure.set_layout_engine("none")  # the picture fills it
    axes: Axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(pixels, extent=(0, WIDTH, 0, height), origin="lower", interpolation="lanczos")
    axes.set(xlim=(0, WIDTH), ylim=(0, height))
    axes.set_axis_off()
    for mark in marks:
        _draw(axes, camera.shares(mark.points) * size, mark.look)
    left = WIDTH - _EDGE - _COLUMN if right else _EDGE
    for k, (name, value) in enumerate(rows):
        y = height - _EDGE - _ROW * k
        axes.text(left, y, name, va="top", weight="normal" if value else "bold", zorder=8)
        axes.text(left + _COLUMN, y, value, va="top", ha="right", zorder=8)
    ends = [(mark.text, camera.shares(mark.ends) * size) for mark in marks[:MAX_CALLOUTS]]
    named = [(text, at[np.argmax(at[:, 0] if right else -at[:, 0])]) for text, at in ends]
    edge, ha = (left, "left") if right else (left + _COLUMN, "right")
    for text, start, at in _callouts(named, edge, height - 2 * _EDGE - _ROW * (len(rows) + 1)):
        axes.plot(*np.array([start, at]).T, color="#404040", lw=0.8, marker="o", ms=2.5, markevery=[1], zorder=6.5)
        shown = axes.text(edge, start[1], text, va="center", ha=ha, zorder=8, linespacing=1.1)
        shown.set_bbox({"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 1})
    _axes_and_scale(axes, camera, round_below(geometry.extent / 5), left)
    taken, column = arm.copy(), np.array([[left - _EDGE, 0], [left + _COLUMN + _EDGE, height]]) / size
    for at in (column, *(camera.shares(mark.points) for mark in marks)):
        (x0, y0), (x1, y1) = np.stack([np.nanmin(at, axis=0), np.nanmax(at, axis=0)]) * taken.shape[::-1]
        taken[int(y0) : int(y1) + 1, int(x0) : int(x1) + 1] = True
    for name, seen in obstacles.items():
        _name(axes, name, seen, taken)
    return figure


def marks_of(geometry: ArmGeometry, way: Array | None = None) -> list[Stroke]:
    """What is drawn over the picture; whose callout is needed most comes first."""
    tool, target, ring, d = geometry.tool_point, geometry.target, geometry.ring, geometry.direction
    dot: Look = {"marker": "o", "color": "black", "mec": "white", "ms": 6, "zorder": 5}
    found = [Stroke(tool[None], dot, f"tool point with its {geometry.region.label}", tool[None])]
    if target is not None and target.missed(tool):
        cross: Look = {"marker": "X", "color": COLOURS["missed"], "mec": "white", "ms": 11, "zorder": 6}
        found.append(Stroke(target.lower[None], cross, "target, not reached", target.lower[None]))
    if ring is not None:
        lines, walls = [ring.points()], ring.walls(np.cross(*geometry.ground[0]), 0.15 * geometry.extent)
        dashed: Look = {"color": COLOURS["ring"], "lw": 2, "ls": "--", "zorder": 4}
        lines += walls if geometry.planar else []  # its rim is seen as a line: the walls make it a hole
        found.append(Stroke(_with_gaps(lines), dashed, ring.label, lines[0]))
    if way is not None:
        line: Look = {"color": VERMILLION, "lw": 1.6, "zorder": 3}
        found.append(Stroke(way, line, "path of the tool point", way[[len(way) // 2]]))
    if target is not None and target.kind == "region":
        corners = np.array(list(product(*zip(target.lower, target.upper, strict=True))))
        edges = np.array([pair for pair in combinations(corners, 2) if np.sum(np.abs(pair[0] - pair[1]) > 1e-9) == 1])
        dotted: Look = {"color": GREY, "lw": 1.2, "ls": ":", "zorder": 3}
        found.append(Stroke(_with_gaps(edges), dotted, "box for the target", 0.2 * edges[:, 0] + 0.8 * edges[:, 1]))
    if d is not None:
        ends = tool + ARROW_SHARE * geometry.extent * np.outer([0.0, 1.0], d)
        found.append(Stroke(ends, _LINE, "direction of the task", ends[1:]))
    return found


def _with_gaps(lines: Iterable[Array]) -> Array:
    """Lines (k, 3) one after the other, with NaN between them."""
    return np.concatenate([row for line in lines for row in (line, np.full((1, 3), np.nan))])


def _callouts(named: Sequence[tuple[str, Array]], edge: float, top: float) -> list[tuple[str, Array, Array]]:
    """Texts with the start of their lines (2,) and what they name (2,) [inch], one below the other in the column;
    ``named`` (2,) [inch], ``edge`` [inch], ``top`` [inch]."""
    options = []
    for order in permutations(named):
        texts = ["\n".join(wrap(text, _LETTERS)) for text, _ in order]
        heights = [_ROW * (text.count("\n") + 1) for text in texts]
        middles = _stacked([float(at[1]) for _, at in order], heights, top)
        starts = [np.array([edge, middle]) for middle in middles]
        options.append([(text, start, at) for text, start, (_, at) in zip(texts, starts, order, strict=True)])
    return min(options, key=lambda option: sum(float(np.linalg.norm(at - start)) for _, start, at in option))


def _stacked(wanted: Sequence[float], heights: Sequence[float], top: float) -> list[float]:
    found, free = [], top
    for middle, tall in zip(wanted, heights, strict=True):
        found.append(min(middle, free - tall / 2))
        free = found[-1] - tall / 2 - _ROW
    free = _SCALE
    for k in reversed(range(len(found))):
        found[k] = max(found[k], free + heights[k] / 2)
        free = found[k] + heights[k] / 2 + _ROW
    return found


def shortened(name: str, most: int) -> str:
    """A name of at most so many letters: of a longer one beginning and end, which number joints of one arm.

    >>> shortened("left_arm_manipulator_joint_1", 15)
    'left_ar…joint_1'
    """
    return name if len(name) <= most else f"{name[: most // 2]}…{name[-(most // 2) :]}"


def _framed(
    geometry: ArmGeometry, marks: Sequence[Stroke], ghosts: Sequence[Solid], column: float
) -> tuple[Camera, bool, float]:
    """The view, whether the column is to the right of the arm, and the height of the figure that suits both [inch];
    ``column`` [inch]."""
    solids = [o for o in geometry.obstacles if np.ptp(o.corners, axis=0).max() < geometry.extent]
    seen = [geometry.points, geometry.region.surface().reshape(-1, 3), *(mark.points for mark in marks)]
    points = np.concatenate([*seen, *(solid.corners for solid in (*solids, *ghosts))])
    points = points[np.isfinite(points[:, 0])]
    camera = best_camera(geometry)
    at = camera.project(points)[:, 0]
    right = bool(camera.project(geometry.tool_point)[0] >= (at.min() + at.max()) / 2)
    aside = (0.05, (_COLUMN + 3 * _EDGE) / WIDTH)
    margins = (*(aside if right else aside[::-1]), 0.08, 0.05)
    wide, high = np.ptp(camera.project(points)[:, :2], axis=0) / [1 - sum(aside), 1 - sum(margins[2:])]
    height = float(np.clip(WIDTH * high / wide, max(_HEIGHTS[0], column), _HEIGHTS[1]))
    return camera.framing(points, WIDTH / height, margins), right, height


def _draw(axes: Axes, line: Array, look: Look) -> None:
    """A line or an arrow (k, 2) [inch]."""
    if "arrowstyle" in look:
        axes.annotate("", tuple(line[-1]), tuple(line[0]), arrowprops=look, zorder=4)
    else:
        axes.plot(*line.T, **look)


def _axes_and_scale(axes: Axes, camera: Camera, step: float, left: float) -> None:
    """The axes of the world and the scale, at the lower end of the column; ``step`` [m], ``left`` [inch]."""
    at = np.array([left + 0.45, 0.42])
    for axis, name in zip(np.eye(3), "xyz", strict=True):
        way = camera.project(axis)[:2]
        if np.linalg.norm(way) > 0.1:
            _draw(axes, np.array([at, at + 0.32 * way]), {**_LINE, "lw": 1.1, "mutation_scale": 7})
            x, y = at + 0.42 * way
            axes.text(x, y, name, ha="center", va="center", zorder=8)
    start, end = left + _COLUMN - step / camera.size[0] * WIDTH, left + _COLUMN
    axes.plot([start, end], [0.22, 0.22], color="black", lw=2, solid_capstyle="butt", zorder=7)
    axes.text((start + end) / 2, 0.28, f"{1e3 * step:g} mm", ha="center", va="bottom", zorder=8)


def _name(axes: Axes, name: str, seen: Mask, taken: Mask) -> None:
    """The name of an obstacle on it, near the middle of what is seen of it, on nothing that is taken; marked as taken;
    ``seen`` (H, W), ``taken`` (H, W)."""
    half = np.ceil([0.1 * taken.shape[0] / axes.get_ylim()[1], _LETTER / 2 * len(name) * taken.shape[1] / WIDTH])
    places = np.argwhere(seen)[:: max(1, np.count_nonzero(seen) // 400)]
    if not len(places):
        return

    def cost(place: Array) -> float:
        low, high = np.maximum(place - half, 0).astype(int), (place + half).astype(int)
        covered = taken[low[0] : high[0], low[1] : high[1]].mean()
        return float(np.linalg.norm(place - np.median(places, axis=0)) + 1e4 * covered)

    row, column = min(places, key=cost)
    taken[int(row - half[0]) : int(row + half[0]), int(column - half[1]) : int(column + half[1])] = True
    x, y = np.array([column, row]) / taken.shape[::-1] * [WIDTH, axes.get_ylim()[1]]
    axes.text(x, y, name, ha="center", va="center", color="#7A4A12", zorder=6)


@styled
def plot_solution(solution: Solution) -> Figure:
    """The arm in the best posture, the 95 % region enlarged by a stated factor, direction and target. Region and hole
    have one scale, and the arm another: a region of some micrometres would be no point of the picture."""
    return _with_joints(solution.spread, ArmGeometry.of_solution(solution))


@styled
def plot_spread(spread: Spread) -> Figure:
    """The arm at a posture with the 95 % region enlarged by a stated factor, and the direction of the task."""
    return _with_joints(spread, ArmGeometry.of_spread(spread))


@styled
def plot_motion(found: Solution) -> Figure:
    """The arm at the worst point of a path as of a solution, faintly at others along it, and the path."""
    geometry = ArmGeometry.of_solution(found.worst)
    arm, Q = ArmSolids(found.worst.spread.tool_point.robot), found.motion.Q
    # Four further postures of the motion.
    others = np.unique(np.linspace(0, len(Q) - 1, 4).round().astype(int)).tolist()
    ghosts = [
        solid.placed(frames)
        for frames in (arm.frames(Q[k]) for k in others if k != found.worst_index)
        for solid in arm.solids
        if solid.role not in ("base",)
    ]
    return _with_joints(found.worst.spread, geometry, ghosts, found.path.points)


def _with_joints(
    spread: Spread, geometry: ArmGeometry, ghosts: Sequence[Solid] = (), way: Array | None = None
) -> Figure:
    """The arm with the values of its joints; ``way`` (k, 3) [m]."""
    robot = spread.tool_point.robot
    units = [joint_unit(joint.type) for joint in robot.joints]
    values = zip(robot.joint_names, spread.q, units, strict=True)
    posture = [(name, f"{fixed(factor * value, 1)} {unit}") for name, value, (unit, factor) in values]
    return draw_arm(geometry, robot.name, posture, ghosts, way)
