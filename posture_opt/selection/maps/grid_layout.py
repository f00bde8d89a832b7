"""Which targets a map covers: ``GridRequest`` says what is asked for, ``grid_of`` chooses what it leaves open.

By default the plane is that of a planar arm, else across the direction of the task, and the box is the task's region,
else 30 % of the reach about its position, else the workspace. Cells are square, 17 along the longer side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.limits import MOST_MAP_TARGETS
from posture_opt.numerics import Array
from posture_opt.selection.maps.map_points import ALIGNED, Grid, along_world_axes
from posture_opt.selection.program.task_target import Reach, TaskTarget
from posture_opt.selection.search.relaxation import plane_reason

Plane = Literal["xy", "xz", "yz"]

_LONGER_SIDE_TARGETS = 17  # targets along it by default: a map of some seconds
_MIN_SIDE_TARGETS = 5  # along the shorter side: fewer show no shape
_POSITION_MARGIN = 0.3  # of the reach, to either side of a position


@dataclass(frozen=True)
class GridRequest:
    """What a map is asked to cover; what is left out is chosen to suit the task.

    Args:
        counts: (2,) in the plane, or (3,) along x, y, z of the world.
        low, high: (3,) corners of a box in the world [m].
        plane: of the world's axes; default: across the direction of the task.
    """

    counts: tuple[int, ...] | None = None
    low: tuple[float, float, float] | None = None
    high: tuple[float, float, float] | None = None
    plane: Plane | None = None

    def check(self) -> None:
        """Raise InputError where counts and corners make no grid, all faults at once."""
        issues = [*self._count_issues(), *self._corner_issues()]
        if self.plane is not None and self.plane not in get_args(Plane):
            hint = f"write one of: {', '.join(get_args(Plane))}"
            issues.append(Issue(f"there is no plane '{self.plane}'", ("--plane",), self.plane, hint))
        if issues:
            raise InputError(issues)

    def _count_issues(self) -> list[Issue]:
        """Counts that make no grid: not two or three of them, one target alone, or more than `MOST_MAP_TARGETS`."""
        if self.counts is None:
            return []
        text, key, hint = (
            "x".join(map(str, self.counts)),
            ("--grid",),
            "write for example 15x15, or 9x9x1 along x, y, z",
        )
        if len(self.counts) not in (2, 3) or min(self.counts) < 1:
            return [Issue(f"{text} is no grid", key, text, hint)]
        if max(self.counts) < 2:
            return [Issue("one target is no map", key, text, hint)]
        total = math.prod(self.counts)
        if total > MOST_MAP_TARGETS.most:
            return [Issue(MOST_MAP_TARGETS.message(total), key, text, MOST_MAP_TARGETS.hint)]
        return []

    def _corner_issues(self) -> list[Issue]:
        """Corners that make no box: one of them missing, not finite, exchanged, or both the same."""
        if (self.low is None) != (self.high is None):
            missing = "--min" if self.low is None else "--max"
            return [Issue("a box has two corners", (missing,), hint="give --min and --max")]
        issues = []
        for key, corner in (("--min", self.low), ("--max", self.high)):
            if corner is not None and (len(corner) != 3 or not all(map(math.isfinite, corner))):
                issues.append(Issue("a corner has three finite coordinates", (key,), corner, '"0.3 m, -0.2 m, 0.1 m"'))
        if self.low is None or self.high is None or issues:
            return issues
        sides = list(zip("xyz", self.low, self.high, strict=True))
        issues += [
            Issue(f"the box is empty in {name}: {low:g} m is above {high:g} m", ("--min",), low, "swap them")
            for name, low, high in sides
            if low > high
        ]
        if not issues and all(low == high for _, low, high in sides):
            issues.append(Issue("the box is one point", ("--max",), self.high, "give it a width in two directions"))
        return issues


def grid_of(request: GridRequest, target: TaskTarget, reach: Reach, points: Array, middle: Array | None) -> Grid:
    """The grid that suits a task.

    Args:
        request: counts, corners and plane, each or none.
        target: with the direction of the task (world); ``reach`` of the arm.
        points: (M, 3) tool points in the world, all over the workspace [m].
        middle: (3,) what the grid is laid about where neither corners nor a region say [m]; default: the target's.

    Raises:
        InputError: a request that makes no grid, or that is not in the plane of this arm.
        NoSolutionError: a box, or a target of the task, outside of the plane (or line) that this arm moves in.
    """
    request.check()
    _check_plane(request, target, reach)
    axes = _frame(request, target, reach)
    aligned = along_world_axes(axes)
    if not aligned and (request.low is not None or (request.counts is not None and len(request.counts) == 3)):
        key = "--min" if request.low is not None else "--grid"
        raise InputError(Issue("the direction of the task is oblique", (key,), hint="add --plane xy, xz or yz"))
    low, high = _box(request, target, reach, points)
    centre = (low + high) / 2 if middle is None else middle
    origin = np.zeros(3) if aligned else centre
    ends = np.array([low, high]) @ axes.T
    if not aligned:
        half = float(np.max(high - low)) / 2
        ends = np.array([[-half, -half, 0.0], [half, half, 0.0]])
    elif target.kind == "anywhere" and request.low is None:
        ends[:, 2] = axes[2] @ centre
    if reach.normals.shape[1]:
        ends[:, 2] = (reach.offset - origin) @ axes[2]
    counts = _counts(request, axes, ends[1] - ends[0])
    order = [0, 1, 2] if max(counts[:2]) > 1 else [2, 0, 1]  # a line is drawn along the first axis
    u, v, w = (_values(ends[0, k], ends[1, k], counts[k]) for k in order)
    return Grid(origin, axes[order], (u, v, w))


def _check_plane(request: GridRequest, target: TaskTarget, reach: Reach) -> None:
    """Raise NoSolutionError where all that is asked for lies outside of the plane that the tool point cannot leave."""
    if request.low is not None and request.high is not None:
        target = replace(target, lower=np.array(request.low), upper=np.array(request.high))
    outside = plane_reason(reach, target)
    if outside is not None:
        raise NoSolutionError(outside.message)


def _values(low: float, high: float, count: int) -> Array:
    """Values (count,) [m] from ``low`` to ``high``; the middle where there is one."""
    return np.asarray((np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2])) + 0.0)


def _frame(request: GridRequest, target: TaskTarget, reach: Reach) -> Array:
    """The axes (3, 3) of the grid, one a row: e1, e2 in the plane of the figure and e3 across it.

    Axes of the world where the plane has them; otherwise those of the arm's plane or of the task.

    Raises:
        InputError: a plane that this arm cannot leave its own for.
    """
    if reach.normals.shape[1] == 1:
        normal = reach.normals[:, 0]
        frame = _of_world(normal)
        if request.plane is not None and (frame is None or not np.array_equal(frame, _of_plane(request.plane))):
            hint = "leave it out: the map lies in the arm's plane"
            raise InputError(
                Issue("the tool point of this arm moves in another plane", ("--plane",), request.plane, hint)
            )
        return np.vstack([reach.directions.T, normal]) if frame is None else frame
    if request.plane is not None:
        return _of_plane(request.plane)
    flat = _flat_axis(request)
    if flat is not None:
        return _of_plane(("yz", "xz", "xy")[flat])
    frame = _of_world(target.direction)
    return np.vstack([target.basis.T, target.direction]) if frame is None else frame


def _flat_axis(request: GridRequest) -> int | None:
    """The axis of the world along which counts or corners leave one value, where there is exactly one such."""
    flat: set[int] = set()
    if request.counts is not None and len(request.counts) == 3:
        flat = {k for k in range(3) if request.counts[k] == 1}
    elif request.low is not None and request.high is not None:
        flat = {k for k in range(3) if request.low[k] == request.high[k]}
    return flat.pop() if len(flat) == 1 else None


def _of_plane(plane: str) -> Array:
    """The axes (3, 3) of a plane of the world, ``xy``, ``xz`` or ``yz``, and the one across it."""
    order = ["xyz".index(c) for c in plane]
    return np.asarray(np.eye(3)[[*order, 3 - sum(order)]])


def _of_world(normal: Array) -> Array | None:
    """The frame of the world's axes across ``normal``, or None where it is oblique to them."""
    axis = int(np.argmax(np.abs(normal)))
    return _of_plane(("yz", "xz", "xy")[axis]) if abs(normal[axis]) > 1 - ALIGNED else None


def _box(request: GridRequest, target: TaskTarget, reach: Reach, points: Array) -> tuple[Array, Array]:
    """Corners (3,) of the box that the grid covers [m], world."""
    if request.low is not None and request.high is not None:
        return np.array(request.low), np.array(request.high)
    if target.kind == "region":
        return target.lower, target.upper
    if target.kind == "point":
        half = _rounded(_POSITION_MARGIN * reach.radius)
        return target.lower - half, target.lower + half
    step = _step(reach.radius / 2)
    return step * np.floor(points.min(axis=0) / step + 1e-6), step * np.ceil(points.max(axis=0) / step - 1e-6)


def _rounded(length: float) -> float:
    """A length [m] rounded to a round step, one at least."""
    step = _step(length)
    return step * max(round(length / step), 1)


def _step(length: float) -> float:
    """A round step that is a small part of a length [m]: half of its power of ten.

    >>> _step(0.35)
    0.05
    """
    power = 10.0 ** math.floor(math.log10(max(length, 1e-3)))
    return 0.5 * power


def _counts(request: GridRequest, axes: Array, widths: Array) -> tuple[int, int, int]:
    """How many values of u, v, w: those that were asked for, in the order of the axes, else suitable ones.

    Raises:
        InputError: several values along an axis in which the box has no width.
    """
    if request.counts is None:
        return _suitable(widths)
    whole = (
        [request.counts[int(np.argmax(np.abs(e)))] for e in axes] if len(request.counts) == 3 else [*request.counts, 1]
    )
    for count, width, axis in zip(whole, widths, axes, strict=True):
        if count > 1 and width <= 0:
            name, text = "xyz"[int(np.argmax(np.abs(axis)))], "x".join(map(str, request.counts))
            raise InputError(Issue(f"the box has no width in {name}", ("--grid",), text, "write 1 there, or widen it"))
    return whole[0], whole[1], whole[2]


def _suitable(widths: Array) -> tuple[int, int, int]:
    """Square cells in the plane and one layer; along a line that lies across the plane, all of them there."""
    longer = float(max(widths[:2]))
    if longer <= 0:
        return 1, 1, _LONGER_SIDE_TARGETS
    u, v = (
        max(round((_LONGER_SIDE_TARGETS - 1) * w / longer / 2) * 2 + 1, _MIN_SIDE_TARGETS) if w > 0 else 1
        for w in widths[:2]
    )
    return u, v, 1
