"""``Grid``: the targets of a map, in a plane that a figure can show."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.selection.goal import Goal
from posture_opt.selection.grid_request import GridRequest
from posture_opt.selection.reach import Reach

Floats = np.ndarray

_LONGER_SIDE = 17
_FEWEST = 5
_AROUND = 0.3  # of the reach, to either side of a position
_ALIGNED = 1e-9


@dataclass(frozen=True, eq=False)
class Grid:
    """Targets ``origin + u e1 + v e2 + w e3``, u running fastest.

    Args:
        origin: (3,) [m], world.
        axes: (3, 3) unit vectors e1, e2, e3, one a row: the two that a figure shows, and the one across them.
        values: of u, v, w [m], ascending.
    """

    origin: Floats
    axes: Floats
    values: tuple[Floats, Floats, Floats]

    @property
    def shape(self) -> tuple[int, int, int]:
        """How many values of w, v and u: the shape of an array over all targets."""
        u, v, w = map(len, self.values)
        return w, v, u

    @property
    def aligned(self) -> bool:
        """Whether u, v, w are coordinates of the world."""
        return not self.origin.any() and bool(np.all(np.max(np.abs(self.axes), axis=1) > 1 - _ALIGNED))

    @cached_property
    def points(self) -> Floats:
        """(N, 3) all targets in the world [m]."""
        w, v, u = np.meshgrid(*self.values[::-1], indexing="ij")
        return np.asarray(self.origin + np.stack([u, v, w], axis=-1).reshape(-1, 3) @ self.axes)

    def coordinates(self, points: Floats) -> Floats:
        """(N, 3) u, v, w of points in the world (N, 3) [m]."""
        return np.asarray((points - self.origin) @ self.axes.T)

    @cached_property
    def neighbours(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
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

    def cells(self, points: Floats) -> np.ndarray:
        """(N,) the target in whose cell each point (N, 3) lies; -1 outside of all cells.

        Across the figure's plane a cell is as thick as its layers lie apart; of a single layer, as its longer side.
        """
        at = self.coordinates(points)
        sides = self.sides
        index, inside = [], np.ones(len(points), dtype=bool)
        for k, values in enumerate(self.values):
            nearest = np.abs(at[:, k, None] - values).argmin(axis=1)
            inside &= np.abs(at[:, k] - values[nearest]) <= sides[k] / 2
            index.append(nearest)
        return np.where(inside, np.ravel_multi_index(tuple(index[::-1]), self.shape), -1)

    def to_json(self) -> dict[str, Any]:
        """Axes, origin and values of the grid [m]."""
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


def grid_of(wish: GridRequest, goal: Goal, reach: Reach, points: Floats, middle: Floats | None) -> Grid:
    """The grid that suits a task.

    Args:
        points: (M, 3) tool points in the world, all over the workspace [m].
        middle: (3,) what the grid is laid about where neither corners nor a region say [m]; default: the goal's.

    Raises:
        InputError: a wish that makes no grid, or that this arm's plane does not hold.
    """
    wish.check()
    axes = _frame(wish, goal, reach)
    aligned = bool(np.all(np.max(np.abs(axes), axis=1) > 1 - _ALIGNED))
    if not aligned and (wish.low is not None or (wish.counts is not None and len(wish.counts) == 3)):
        key = "--min" if wish.low is not None else "--grid"
        raise InputError(Issue("the direction of the task is oblique", (key,), mend="add --plane xy, xz or yz"))
    low, high = _box(wish, goal, reach, points)
    centre = (low + high) / 2 if middle is None else middle
    origin = np.zeros(3) if aligned else centre
    ends = np.array([low, high]) @ axes.T
    if not aligned:
        half = float(np.max(high - low)) / 2
        ends = np.array([[-half, -half, 0.0], [half, half, 0.0]])
    elif goal.kind == "anywhere" and wish.low is None:
        ends[:, 2] = axes[2] @ centre
    if reach.normals.shape[1]:
        ends[:, 2] = (reach.offset - origin) @ axes[2]
    counts = _counts(wish, axes, ends[1] - ends[0])
    order = [0, 1, 2] if max(counts[:2]) > 1 else [2, 0, 1]  # a line is drawn along the first axis
    u, v, w = (_values(ends[0, k], ends[1, k], counts[k]) for k in order)
    return Grid(origin, axes[order], (u, v, w))


def _values(low: float, high: float, count: int) -> Floats:
    return np.asarray((np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2])) + 0.0)


def _frame(wish: GridRequest, goal: Goal, reach: Reach) -> Floats:
    """(3, 3) e1, e2 in the plane of the figure and e3 across it, one a row."""
    if reach.normals.shape[1] == 1:
        normal = reach.normals[:, 0]
        frame = _of_world(normal)
        if wish.plane is not None and (frame is None or not np.array_equal(frame, _of_plane(wish.plane))):
            mend = "leave it out: the map lies in the arm's plane"
            raise InputError(Issue("the tool point of this arm moves in another plane", ("--plane",), wish.plane, mend))
        return np.vstack([reach.directions.T, normal]) if frame is None else frame
    if wish.plane is not None:
        return _of_plane(wish.plane)
    flat = _flat_axis(wish)
    if flat is not None:
        return _of_plane(("yz", "xz", "xy")[flat])
    frame = _of_world(goal.direction)
    return np.vstack([goal.basis.T, goal.direction]) if frame is None else frame


def _flat_axis(wish: GridRequest) -> int | None:
    """The axis of the world along which counts or corners leave one value, where there is exactly one such."""
    flat: set[int] = set()
    if wish.counts is not None and len(wish.counts) == 3:
        flat = {k for k in range(3) if wish.counts[k] == 1}
    elif wish.low is not None and wish.high is not None:
        flat = {k for k in range(3) if wish.low[k] == wish.high[k]}
    return flat.pop() if len(flat) == 1 else None


def _of_plane(plane: str) -> Floats:
    order = ["xyz".index(c) for c in plane]
    return np.asarray(np.eye(3)[[*order, 3 - sum(order)]])


def _of_world(normal: Floats) -> Floats | None:
    """The frame of the world's axes across ``normal``, or None where it is oblique to them."""
    axis = int(np.argmax(np.abs(normal)))
    return _of_plane(("yz", "xz", "xy")[axis]) if abs(normal[axis]) > 1 - _ALIGNED else None


def _box(wish: GridRequest, goal: Goal, reach: Reach, points: Floats) -> tuple[Floats, Floats]:
    """Corners (3,) of the box that the grid covers [m], world."""
    if wish.low is not None and wish.high is not None:
        return np.array(wish.low), np.array(wish.high)
    if goal.kind == "region":
        return goal.lower, goal.upper
    if goal.kind == "point":
        half = _rounded(_AROUND * reach.radius)
        return goal.lower - half, goal.lower + half
    step = _step(reach.radius / 2)
    return step * np.floor(points.min(axis=0) / step + 1e-6), step * np.ceil(points.max(axis=0) / step - 1e-6)


def _rounded(length: float) -> float:
    step = _step(length)
    return step * max(round(length / step), 1)


def _step(length: float) -> float:
    """A round step that is a small part of a length: 50 mm of 0.35 m."""
    power = 10.0 ** math.floor(math.log10(max(length, 1e-3)))
    return 0.5 * power


def _counts(wish: GridRequest, axes: Floats, widths: Floats) -> tuple[int, int, int]:
    """How many values of u, v, w."""
    if wish.counts is None:
        return _suitable(widths)
    whole = [wish.counts[int(np.argmax(np.abs(e)))] for e in axes] if len(wish.counts) == 3 else [*wish.counts, 1]
    for count, width, axis in zip(whole, widths, axes, strict=True):
        if count > 1 and width <= 0:
            name, text = "xyz"[int(np.argmax(np.abs(axis)))], "x".join(map(str, wish.counts))
            raise InputError(Issue(f"the box has no width in {name}", ("--grid",), text, "write 1 there, or widen it"))
    return whole[0], whole[1], whole[2]


def _suitable(widths: Floats) -> tuple[int, int, int]:
    """Square cells in the plane and one layer; along a line that lies across the plane, all of them there."""
    longer = float(max(widths[:2]))
    if longer <= 0:
        return 1, 1, _LONGER_SIDE
    u, v = (max(round((_LONGER_SIDE - 1) * w / longer / 2) * 2 + 1, _FEWEST) if w > 0 else 1 for w in widths[:2])
    return u, v, 1
