"""``TaskPath``: the points that a task follows, with their tangents and tool axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.limits import MOST_PATH_POINTS
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.selection.program.task_target import Reach, TaskTarget, turned_about_z
from posture_opt.selection.tasks.path_task import PathTask
from posture_opt.uncertainty.task_spread import across_basis


@dataclass(frozen=True)
class TaskPath:
    """Points in their order: listed ones, and more between them where they stand far apart."""

    points: Array  # (K, 3) world [m]
    # (K, 3) unit vectors of travel: the segment's; at a listed point the bisector of the two that meet there.
    tangents: Array
    axes: Array  # (K, 3) unit vectors, world, where the tool axis is to point; turned evenly between listed points
    listed: Mask  # (K,) whether the point is one of the task's own
    parts: Array  # (K − 1,) into how many steps the step between two listed points is divided there
    origin: Array  # (3,) of the workpiece that the points lie on [m], world: what its angle turns them about

    @classmethod
    def of(cls, task: PathTask) -> TaskPath:
        """Path of a task, with points added where ``spacing`` asks for them; InputError for too many."""
        points, axes, along = np.array(task.tool_points), np.array(task.unit_axes), tangents(np.array(task.points))
        every, steps = np.ones(len(points), dtype=bool), np.ones(len(points) - 1, dtype=int)
        listed = cls(points, along, axes, every, steps, np.array(task.origin))
        return listed if task.spacing is None else listed._spaced(task.spacing)

    def at(self, numbers: Codes) -> TaskPath:
        """Path through some of its points, both ends among them; steps count as their parts do on average."""
        spans, counted = np.diff(numbers), np.concatenate([[0.0], np.cumsum(self.parts)])
        parts = np.diff(counted[numbers]) / spans**2
        rows = {name: getattr(self, name)[numbers] for name in ("points", "tangents", "axes")}
        return replace(self, **rows, listed=np.ones(len(numbers), dtype=bool), parts=parts)

    def moved(self, w: Array) -> TaskPath:
        """The path in a frame that stands at w = (x, y, z, yaw) [m, rad]."""
        points, along, axes, origin = (
            turned_about_z(rows.T, np.cos(w[3]), np.sin(w[3])).T
            for rows in (self.points, self.tangents, self.axes, self.origin)
        )
        return replace(self, points=points + w[:3], tangents=along, axes=axes, origin=origin + w[:3])

    def targets(self, base: TaskTarget, reach: Reach) -> list[TaskTarget]:
        """Targets of the points: the spread across the tangent, the tool along the axis."""
        return [
            replace(
                base, lower=x, upper=x, direction=t, basis=across_basis(t, reach.normal),
                axis=a, axis_basis=across_basis(a, reach.normal), lever=x - self.origin,
            )
            for x, t, a in zip(self.points, self.tangents, self.axes, strict=True)
        ]  # fmt: skip

    @cached_property
    def lengths(self) -> Array:
        """(K,) way along the path up to each point [m]."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])

    @cached_property
    def numbers(self) -> list[str]:
        """Name of each point: its number in the task, or the two that it lies between."""
        count, names = 0, []
        for listed in self.listed:
            count += int(listed)
            names.append(f"point {count}" if listed else f"between points {count} and {count + 1}")
        return names

    def _spaced(self, spacing: float) -> TaskPath:
        """The path with points between those farther apart than ``spacing`` [m]."""
        rows: list[tuple[Array, Array, Array, bool]] = []
        parts: list[int] = []
        gaps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        counts = np.maximum(np.ceil(gaps / spacing - 1e-9), 1)
        MOST_PATH_POINTS.check_at(int(min(counts.sum(), 1e12)) + 1, ("task", "spacing"), "widen it")
        for k, (gap, count) in enumerate(zip(gaps.tolist(), counts.astype(int).tolist(), strict=True)):
            along = (self.points[k + 1] - self.points[k]) / gap
            rows.append((self.points[k], self.tangents[k], self.axes[k], True))
            for s in (np.arange(1, count) / count).tolist():
                point = (1 - s) * self.points[k] + s * self.points[k + 1]
                rows.append((point, along, between(self.axes[k], self.axes[k + 1], s), False))
            parts += [count] * count
        rows.append((self.points[-1], self.tangents[-1], self.axes[-1], True))
        points, directions, axes, listed = (np.array(column) for column in zip(*rows, strict=True))
        return TaskPath(points, directions, axes, listed, np.array(parts), self.origin)


def tangents(points: Array) -> Array:
    """(K, 3) unit vectors of travel at the points (K, 3) of a polyline, as `TaskPath` defines them."""
    along = np.diff(points, axis=0)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    closed = np.linalg.norm(points[0] - points[-1]) < 1e-9  # m
    into = np.vstack([along[-1:] if closed else along[:1], along])
    out = np.vstack([along, along[:1] if closed else along[-1:]])
    both = into + out
    length = np.linalg.norm(both, axis=1, keepdims=True)
    # Where the path turns back on itself the line is the same both ways.
    return np.where(length > 1e-9, both / np.maximum(length, 1e-9), out)


def between(a: Array, b: Array, s: float) -> Array:
    """(3,) unit vector at a share ``s`` of the angle from unit vector ``a`` to ``b``."""
    angle = float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
    if np.sin(angle) < 1e-9:
        return np.asarray(a if s < 0.5 else b)
    return np.asarray((np.sin((1 - s) * angle) * a + np.sin(s * angle) * b) / np.sin(angle))


def stacked(targets: Sequence[TaskTarget]) -> Array:
    """(K, p) parameters of targets."""
    return np.array([target.parameters for target in targets])
