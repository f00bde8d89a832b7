"""The targets of a map: ``GridRequest`` says what is asked for, ``grid_of`` chooses what it leaves open."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, get_args

import numpy as np

from posture_opt.encoding import Encoded
from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.limits import MOST_MAP_TARGETS
from posture_opt.numerics import Array, Codes
from posture_opt.selection.program.task_target import Reach, TaskTarget
from posture_opt.selection.search.relaxation import plane_reason

Plane = Literal["xy", "xz", "yz"]

_LONGER_SIDE_TARGETS = 17
"""Targets along it by default: a map of some seconds."""
_ALIGNED = 1 - 1e-9
"""Least component along an axis of the world of a unit vector that lies along it."""


@dataclass(frozen=True, eq=False)
class Grid(Encoded, json="origin axes values order"):
    """Targets ``origin + u e1 + v e2 + w e3``, u running fastest."""

    origin: Array  # (3,) [m], world
    axes: Array  # (3, 3) unit vectors e1, e2, e3, one a row: the two that a figure shows, and the one across them
    values: tuple[Array, Array, Array]  # of u, v, w [m], ascending
    order: ClassVar[str] = "the first axis runs fastest"

    @property
    def shape(self) -> tuple[int, int, int]:
        """How many values of w, v and u: the shape of an array over all targets."""
        u, v, w = map(len, self.values)
        return w, v, u

    @property
    def aligned(self) -> bool:
        """Whether u, v, w are coordinates of the world."""
        return not self.origin.any() and along_world_axes(self.axes)

    @cached_property
    def points(self) -> Array:
        """(N, 3) all targets in the world [m]."""
        w, v, u = np.meshgrid(*self.values[::-1], indexing="ij")
        return np.asarray(self.origin + np.stack([u, v, w], axis=-1).reshape(-1, 3) @ self.axes)

    def coordinates(self, points: Array) -> Array:
        """(N, 3) u, v, w of points in the world (N, 3) [m]."""
        return np.asarray((points - self.origin) @ self.axes.T)

    @cached_property
    def neighbours(self) -> tuple[tuple[Codes, Codes], ...]:
        """For every direction to one of the neighbours: the targets that have one there, and those neighbours."""
        index, pairs = np.arange(math.prod(self.shape)).reshape(self.shape), []
        for step in ((0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 1, 1), (0, 1, -1)):
            here, there = (
                index[tuple(slice(max(-d * s, 0), n - max(d * s, 0)) for s, n in zip(step, self.shape, strict=True))]
                for d in (1, -1)
            )
            pairs += [(here.ravel(), there.ravel()), (there.ravel(), here.ravel())] if here.size else []
        return tuple(pairs)

    def cells(self, points: Array) -> Codes:
        """(N,) target whose cell holds each point (N, 3) [m], world; −1 outside of all."""
        index, inside = [], np.ones(len(points), dtype=bool)
        for at, values, side in zip(self.coordinates(points).T, self.values, self.sides, strict=True):
            nearest = np.abs(at[:, None] - values).argmin(axis=1)
            inside &= np.abs(at - values[nearest]) <= side / 2
            index.append(nearest)
        return np.where(inside, np.ravel_multi_index(tuple(index[::-1]), self.shape), -1)

    @property
    def sides(self) -> tuple[float, float, float]:
        """Edges of a cell along u, v, w [m]; along an axis with one value, the longest of the others."""
        steps = [float(values[1] - values[0]) if len(values) > 1 else 0.0 for values in self.values]
        a, b, c = (step or max(steps) for step in steps)
        return a, b, c


def along_world_axes(axes: Array) -> bool:
    """Whether unit vectors (k, 3), one a row, all lie along axes of the world."""
    return bool(np.all(np.max(np.abs(axes), axis=1) > _ALIGNED))


@dataclass(frozen=True)
class GridRequest:
    """What a map is asked to cover; what is left out is chosen to suit the task."""

    counts: tuple[int, ...] | None = None  # (2,) in the plane, or (3,) along x, y, z of the world
    low: tuple[float, float, float] | None = None  # low, high: (3,) corners of a box in the world [m]
    high: tuple[float, float, float] | None = None
    plane: Plane | None = None  # of the world's axes; default: across the direction of the task

    @property
    def box(self) -> tuple[Array, Array] | None:
        """Corners (3,) [m], world."""
        return None if self.low is None or self.high is None else (np.array(self.low), np.array(self.high))

    def check(self) -> None:
        """Raise InputError with all faults of counts, corners and plane at once."""
        issues = [*self._count_issues(), *self._corner_issues()]
        if self.plane is not None and self.plane not in get_args(Plane):
            hint = f"write one of: {', '.join(get_args(Plane))}"
            issues.append(Issue(f"there is no plane '{self.plane}'", ("--plane",), self.plane, hint))
        if issues:
            raise InputError(issues)

    def _count_issues(self) -> list[Issue]:
        if self.counts is None:
            return []
        text, hint = "x".join(map(str, self.counts)), "write for example 15x15, or 9x9x1 along x, y, z"
        total = math.prod(self.counts)
        if len(self.counts) not in (2, 3) or min(self.counts) < 1:
            message = f"{text} is no grid"
        elif max(self.counts) < 2:
            message = "one target is no map"
        elif total > MOST_MAP_TARGETS.most:
            message, hint = MOST_MAP_TARGETS.message(total), MOST_MAP_TARGETS.hint
        else:
            return []
        return [Issue(message, ("--grid",), text, hint)]

    def _corner_issues(self) -> list[Issue]:
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
    """Grid for a task, from tool points (M, 3) [m] all over the workspace, laid about ``middle`` (3,) [m], world."""
    request.check()
    asked = target if request.box is None else replace(target, lower=request.box[0], upper=request.box[1])
    if (outside := plane_reason(reach, asked)) is not None:
        raise NoSolutionError(outside.message)
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
    (low, high), middle = ends, ends.mean(axis=0, keepdims=True)
    u, v, w = (np.linspace(low[k], high[k], counts[k]) + 0.0 if counts[k] > 1 else middle[:, k] + 0.0 for k in order)
    return Grid(origin, axes[order], (u, v, w))


def _frame(request: GridRequest, target: TaskTarget, reach: Reach) -> Array:
    """(3, 3) axes of the grid, one a row: e1, e2 in the plane of the figure, e3 across it."""
    if reach.normals.shape[1] == 1:
        normal = reach.normals[:, 0]
        frame = _of_world(normal)
        if request.plane is not None and (frame is None or not np.array_equal(frame, _of_plane(request.plane))):
            message = "the tool point of this arm moves in another plane"
            raise InputError(
                Issue(message, ("--plane",), request.plane, "leave it out: the map lies in the arm's plane")
            )
        return np.vstack([reach.directions.T, normal]) if frame is None else frame
    if request.plane is not None:
        return _of_plane(request.plane)
    # The one axis of the world along which counts or corners leave one value, else the direction of the task.
    flat: list[int] = []
    if request.counts is not None and len(request.counts) == 3:
        flat = [k for k in range(3) if request.counts[k] == 1]
    elif request.box is not None:
        flat = np.flatnonzero(request.box[0] == request.box[1]).tolist()
    frame = _of_world(np.eye(3)[flat[0]] if len(flat) == 1 else target.direction)
    return np.vstack([target.basis.T, target.direction]) if frame is None else frame


def _of_plane(plane: str) -> Array:
    """(3, 3) axes of the world in a plane such as ``xy``, and the one across it."""
    order = ["xyz".index(c) for c in plane]
    return np.asarray(np.eye(3)[[*order, 3 - sum(order)]])


def _of_world(normal: Array) -> Array | None:
    """(3, 3) axes of the world across ``normal`` (3,); None where it is oblique to them."""
    axis = int(np.argmax(np.abs(normal)))
    return _of_plane(("yz", "xz", "xy")[axis]) if abs(normal[axis]) > _ALIGNED else None


def _box(request: GridRequest, target: TaskTarget, reach: Reach, points: Array) -> tuple[Array, Array]:
    """Corners (3,) of the box that the grid covers [m], world."""
    if request.box is not None:
        return request.box
    if target.kind == "region":
        return target.lower, target.upper
    if target.kind == "point":
        step = _step(0.3 * reach.radius)
        half = step * max(round(0.3 * reach.radius / step), 1)
        return target.lower - half, target.lower + half
    step = _step(reach.radius / 2)
    return step * np.floor(points.min(axis=0) / step + 1e-6), step * np.ceil(points.max(axis=0) / step - 1e-6)


def _step(length: float) -> float:
    """Half of a length's power of ten [m]: 0.05 of 0.35."""
    return 0.5 * 10.0 ** math.floor(math.log10(max(length, 1e-3)))


def _counts(request: GridRequest, axes: Array, widths: Array) -> tuple[int, int, int]:
    if request.counts is None:
        return _suitable(widths)
    along = [int(np.argmax(np.abs(axis))) for axis in axes]
    whole = [request.counts[k] for k in along] if len(request.counts) == 3 else [*request.counts, 1]
    for count, width, k in zip(whole, widths, along, strict=True):
        if count > 1 and width <= 0:
            name, text = "xyz"[k], "x".join(map(str, request.counts))
            raise InputError(Issue(f"the box has no width in {name}", ("--grid",), text, "write 1 there, or widen it"))
    return whole[0], whole[1], whole[2]


def _suitable(widths: Array) -> tuple[int, int, int]:
    longer = float(max(widths[:2]))
    if longer <= 0:
        return 1, 1, _LONGER_SIDE_TARGETS
    u, v = (max(round((_LONGER_SIDE_TARGETS - 1) * w / longer / 2) * 2 + 1, 5) if w > 0 else 1 for w in widths[:2])
    return u, v, 1
