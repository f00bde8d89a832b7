"""``PathTask``: a task that follows a path of points, one posture for each of them."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, WithJsonSchema, field_validator, model_validator

from posture_opt.errors import BadValueError
from posture_opt.limits import MOST_PATH_POINTS
from posture_opt.numerics import Array
from posture_opt.selection.tasks.task import Task, seen_from
from posture_opt.selection.tasks.workpiece import Direction, Workpiece
from posture_opt.uncertainty.clearance import Within
from posture_opt.units import Angle, Length, parse_quantity

Point = tuple[Length, Length, Length]
_APART = 1e-9  # m: points nearer to each other than this are one


def _speed(value: object) -> object:
    """A speed [m/s], or the word ``highest``."""
    return value if value == HIGHEST else parse_quantity(value, "velocity")


HIGHEST = "highest"  # the speed that the joints allow
Speed = Annotated[
    float | Literal["highest"],
    BeforeValidator(_speed),
    WithJsonSchema({
        "type": ["string", "number"], "minimum": 0, "maximum": 0, "description": "velocity with its unit, or highest",
        "examples": ["20 mm/s", HIGHEST], "dimension": "velocity",
    }),
]  # fmt: skip


class PathTask(Task):
    """A task along a path; without ``path`` and ``points`` it is one at a single place, as the others are.

    The spread counts across the tangent of the path, and the postures follow each other without jumps.
    """

    direction_name: ClassVar[str] = "path"

    path: str | None = Field(None, min_length=1, description="CSV file: x, y, z with a length unit; dx, dy, dz: axis")
    points: tuple[Point, ...] | None = Field(None, description="the points, where they do not stand in a file")
    axes: tuple[Direction, ...] | None = Field(None, description="where the tool axis points, one for each point")
    largest_step: Annotated[Angle, Field(gt=0)] | None = Field(
        None, description="of any joint between listed points; a slide may move 1 m where a joint may turn by 1 rad"
    )
    spacing: Annotated[Length, Field(gt=0)] | None = Field(
        None, description="largest distance; more points are added. Default: 5 % of the length of the arm"
    )
    closed: bool = Field(False, description="ends in the posture in which it began, or whole turns of a joint away")
    speed: Speed | None = Field(
        None, description="of the tool point along the path, constant; `highest`: by the joints"
    )

    @property
    def on_path(self) -> bool:
        return self.points is not None or self.path is not None

    @property
    def on_workpiece(self) -> bool:
        """Whether there is a path, or a feature, that is in the frame of a workpiece."""
        return self.on_path or super().on_workpiece

    @property
    def places(self) -> tuple[Point, ...]:
        """The points of the path, else those of the features."""
        return super().places if self.points is None else self.tool_points

    def in_frame(self, T: Array) -> dict[str, object]:
        """The fields of `Task.in_frame`, and points and axes where they are not in the frame of a workpiece."""
        found = super().in_frame(T)
        if self.points is not None and self.workpiece is None:
            found["points"] = tuple(seen_from(T[:3, :3], point, T[:3, 3]) for point in self.points)
            axes = None if self.axes is None else tuple(seen_from(T[:3, :3], axis) for axis in self.axes)
            found["axes"] = axes
        return found

    @property
    def axis_request(self) -> Literal["aligned", "required", "free"]:
        """The class's ``axis``; with ``axes`` a free one is aligned where the arm can."""
        return "aligned" if self.axis == "free" and self.axes is not None else self.axis

    def direction_at(self, point: Point) -> Point:
        """The direction of travel on the segment that is nearest; the workpiece in the middle of its ranges."""
        if self.points is None:
            return self.direction
        moved = [(self.workpiece or Workpiece()).central(one) for one in self.points]
        a, b = min(pairwise(moved), key=lambda ends: _distance(point, *ends))
        return b[0] - a[0], b[1] - a[1], b[2] - a[2]

    @property
    def unit_axes(self) -> tuple[Point, ...]:
        """Where the tool axis is to point at each point: ``axes``, or ``direction`` everywhere."""
        axes = self.axes if self.axes is not None else (self.direction,) * len(self.points or ())
        return tuple((x / r, y / r, z / r) for x, y, z in axes for r in (math.hypot(x, y, z),))

    @property
    def tool_points(self) -> tuple[Point, ...]:
        """Where the tool point goes [m]."""
        assert self.points is not None
        return self.points

    def with_points(self, points: tuple[Point, ...], axes: tuple[Direction, ...] | None) -> PathTask:
        """The task with the points [m] and tool axes of its file."""
        found = self.model_copy(update={"points": points, "axes": axes})
        found.check_closed()
        return found

    @property
    def stated_speed(self) -> float | None:
        """Speed of the tool point along the path [m/s], or None."""
        return self.speed if isinstance(self.speed, float) else None

    def check_closed(self) -> None:
        """Refuse a closed path with another end than its beginning."""
        if not self.closed or self.points is None:
            return
        gap = math.dist(self.points[0], self.points[-1])
        if gap > _APART:
            message = f"the path is closed, and its last point is {gap * 1e3:.4g} mm from the first one"
            raise BadValueError(message, "add the first point as the last one too")
        if math.dist(self.unit_axes[0], self.unit_axes[-1]) > _APART:
            message = "the path is closed, and the tool axis at its end is not that at its beginning"
            raise BadValueError(message, "give the first axis as the last one too")
        if len(self.points) < 3:
            raise BadValueError("a closed path has at least two different points", "add points")

    @field_validator("points", mode="before")
    @classmethod
    def _not_too_many(cls, points: object) -> object:
        if isinstance(points, list | tuple):
            MOST_PATH_POINTS.check(len(points))
        return points

    @field_validator("points", mode="after")
    @classmethod
    def _distinct_points(cls, points: tuple[Point, ...] | None, info: ValidationInfo) -> tuple[Point, ...] | None:
        if points is not None:
            if len(points) < 2:
                raise BadValueError("a path has at least two points", "add points, or give the point as position")
            for k in repeated(points):
                raise BadValueError(f"point {k + 2} is where point {k + 1} is", "leave one of them out")
        return points

    @model_validator(mode="before")
    @classmethod
    def _one_path(cls, data: object) -> object:
        if isinstance(data, dict):
            given = [key for key in ("path", "points", "position", "region", "features") if data.get(key)]
            if len(given) > 1 and given[0] in ("path", "points"):
                raise BadValueError(f"{' and '.join(given)} are given", "keep one of them")
        return data

    @field_validator("speed", mode="after")
    @classmethod
    def _moving(cls, speed: float | Literal["highest"] | None) -> float | Literal["highest"] | None:
        """The speed, above zero."""
        if isinstance(speed, float) and not speed > 0:
            raise BadValueError("the speed is not above zero", "write for example 20 mm/s, or highest")
        return speed

    @model_validator(mode="after")
    def _keys_of_a_path(self) -> PathTask:
        if (self.closed or self.speed is not None) and not self.on_path:
            hint = "add points: [[…], …] or path: FILE.csv"
            raise BadValueError("closed and speed belong to a path, and none is given", hint)
        return self

    @model_validator(mode="after")
    def _axes_belong_to_points(self) -> PathTask:
        if self.axes is not None and (self.points is None or len(self.axes) != len(self.points)):
            message = f"{len(self.axes)} axes for {len(self.points or ())} points"
            raise BadValueError(message, "give one axis [dx, dy, dz] for each point")
        self.check_closed()
        return self


def _distance(point: Point, a: Point, b: Point) -> float:
    """Distance [m] of a point (3,) from the segment between a and b."""
    along = sum((q - p) * (x - p) for x, p, q in zip(point, a, b, strict=True)) / math.dist(a, b) ** 2
    share = min(max(along, 0.0), 1.0)
    nearest = [p + share * (q - p) for p, q in zip(a, b, strict=True)]
    return math.dist(point, nearest)


def repeated(points: tuple[Point, ...]) -> list[int]:
    """Points (their numbers from 0) that the next one repeats, closer than 1e-9 m."""
    return [k for k, (a, b) in enumerate(pairwise(points)) if math.dist(a, b) < _APART]


class SeamTask(PathTask):
    """A path with the tool axis along its own axes, or along ``direction`` where it states none, within the tilt.

    The spread counts across the travel, sideways and in the distance from the seam alike: both change the bead.
    """

    within: ClassVar[Within] = "across"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "aligned"

    standoff: Annotated[Length, Field(ge=0)] = Field(
        0.0, description="distance of the tool point from the path, against the direction"
    )

    @property
    def tool_points(self) -> tuple[Point, ...]:
        """Where the tool point goes: off the seam by the stand-off, against the tool axis."""
        points = super().tool_points
        if not self.standoff:
            return points
        axes = self.unit_axes
        return tuple(
            (x - self.standoff * dx, y - self.standoff * dy, z - self.standoff * dz)
            for (x, y, z), (dx, dy, dz) in zip(points, axes, strict=True)
        )

    @model_validator(mode="after")
    def _needs_a_seam(self) -> SeamTask:
        if not self.on_path:
            hint = "add path: seam.csv, or points: [[0.5 m, 0 m, 0.1 m], [0.6 m, 0 m, 0.1 m]]"
            raise BadValueError(f"{self.kind} follows a seam and none is given", hint)
        return self
