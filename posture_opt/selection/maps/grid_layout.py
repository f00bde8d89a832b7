"""The targets of a map: ``GridRequest`` says what is asked for, ``grid_of`` chooses what it leaves open."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from posture_opt.errors import InputError, Issue, NoSolutionError
from posture_opt.limits import MOST_MAP_TARGETS
from posture_opt.numerics import Array, Codes, Json
from posture_opt.selection.program.task_target import Reach, TaskTarget
from posture_opt.selection.search.relaxation import plane_reason

Plane = Literal["xy", "xz", "yz"]

_LONGER_SIDE_TARGETS = 17  # targets along it by default: a map of some seconds


ALIGNED = 1e-9  # off one, of the largest component of a unit vector along an axis: rounding


@dataclass(frozen=True, eq=False)
class Grid:
    """Targets ``origin + u e1 + v e2 + w e3``, u running fastest."""

    origin: Array  # (3,) [m], world
    axes: Array  # (3, 3) unit vectors e1, e2, e3, one a row: the two that a figure shows, and the one across them
    values: tuple[Array, Array, Array]  # of u, v, w [m], ascending

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
        index = np.arange(math.prod(self.shape)).reshape(self.shape)
        steps = [(0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 1, 1), (0, 1, -1)]
        pairs = []
        for step in steps:
            here = index[tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in zip(step, self.shape, strict=True))].ravel()
            there = index[
                tuple(slice(max(s, 0), n - max(-s, 0)) for s, n in zip(step, self.shape, strict=True))
            ].ravel()
            pairs += [(here, there), (there, here)] if len(here) else []
        return tuple(pairs)

    def cells(self, points: Array) -> Codes:
        """(N,) target whose cell holds each point (N, 3) [m], world; −1 outside of all."""
        at = self.coordinates(points)
        sides = self.sides
        index, inside = [], np.ones(len(points), dtype=bool)
        for k, values in enumerate(self.values):
            nearest = np.abs(at[:, k, None] - values).argmin(axis=1)
            inside &= np.abs(at[:, k] - values[nearest]) <= sides[k] / 2
            index.append(nearest)
        return np.where(inside, np.ravel_multi_index(tuple(index[::-1]), self.shape), -1)

    def to_json(self) -> dict[str, Json]:
        """Axes, origin [m] and values [m] of the grid, world."""
        return {
            "origin": self.origin.tolist(),
            "axes": self.axes.tolist(),
            "values": [values.tolist() for values in self.values],
            "order": "the first axis runs fastest",
        }

    @property
    def sides(self) -> tuple[float, float, float]:
        """Edges of a cell along u, v, w [m]; along an axis with one value, the longest of the others."""
        steps = [float(values[1] - values[0]) if len(values) > 1 else 0.0 for values in self.values]
        a, b, c = (step or max(steps) for step in steps)
        return a, b, c


def along_world_axes(axes: Array) -> bool:
    """Whether unit vectors (k, 3), one a row, all lie along axes of the world."""
    return bool(np.all(np.max(np.abs(axes), axis=1) > 1 - ALIGNED))


@dataclass(frozen=True)
class GridRequest:
    """What a map is asked to cover; what is left out is chosen to suit the task."""

    counts: tuple[int, ...] | None = None  # (2,) in the plane, or (3,) along x, y, z of the world
    low: tuple[float, float, float] | None = None  # low, high: (3,) corners of a box in the world [m]
    high: tuple[float, float, float] | None = None
    plane: Plane | None = None  # of the world's axes; default: across the direction of the task

    def check(self) -> None:
        """Raise InputError where counts and corners make no grid, all faults at once."""
        issues = [*self._count_issues(), *self._corner_issues()]
        if self.plane is not None and self.plane not in get_args(Plane):
            hint = f"write one of: {', '.join(get_args(Plane))}"
            issues.append(Issue(f"there is no plane '{self.plane}'", ("--plane",), self.plane, hint))
        if issues:
            raise InputError(issues)

    def _count_issues(self) -> list[Issue]:
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
    if request.low is not None and request.high is not None:
        target = replace(target, lower=np.array(request.low), upper=np.array(request.high))
    outside = plane_reason(reach, target)
    if outside is not None:
        raise NoSolutionError(outside.message)


def _values(low: float, high: float, count: int) -> Array:
    """Values (count,) [m] from ``low`` to ``high``; the middle where there is one."""
    return np.asarray((np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2])) + 0.0)


def _frame(request: GridRequest, target: TaskTarget, reach: Reach) -> Array:
    """(3, 3) axes of the grid, one a row: e1, e2 in the plane of the figure, e3 across it."""
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
        half = _rounded(0.3 * reach.radius)
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
    """Counts of u, v, w."""
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
    longer = float(max(widths[:2]))
    if longer <= 0:
        return 1, 1, _LONGER_SIDE_TARGETS
    u, v = (max(round((_LONGER_SIDE_TARGETS - 1) * w / longer / 2) * 2 + 1, 5) if w > 0 else 1 for w in widths[:2])
    return u, v, 1
