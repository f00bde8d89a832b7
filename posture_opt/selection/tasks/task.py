"""``Task``: what the tool point has to do, and therefore which part of its scatter matters.

A kind is a class whose fields are its keys in the file. Four of its class variables say what it means: which part of
the spread counts (``within``), what is asked of the tool axis (``axis``), and how it is named. Nobody asks a task for
its kind.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from posture_opt.errors import BadValueError, InputError, Issue
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.robot.shape_section import product_of
from posture_opt.selection.tasks.workpiece import Combine, Direction, Features, Workpiece
from posture_opt.selection.terms import TermSpec
from posture_opt.spec import Spec
from posture_opt.uncertainty.clearance import Within
from posture_opt.uncertainty.peg_spread import HeldPart
from posture_opt.units import Angle, Celsius, Length, Mass, Share, Time

Criterion = Annotated[
    Literal["worst", "trace", "area", "miss", "none"],
    Field(description="worst axis, RMS, area, mean square miss, or none of it"),
]


Point = tuple[float, float, float]


def seen_from(R: Array, vector: Point, p: Array | None = None) -> Point:
    """A direction, or with p a point, from another frame: ``R v``, ``R v + p``."""
    x, y, z = (R @ vector + (0.0 if p is None else p)).tolist()
    return x, y, z


class Region(Spec):
    """A box in the world [m] that the tool point may be placed in, its sides along the axes.

    The search chooses the point in it together with the posture.
    """

    min: tuple[Length, Length, Length] = Field(description="corner with the least x, y, z; world")
    max: tuple[Length, Length, Length] = Field(description="corner with the largest x, y, z; world")

    @model_validator(mode="after")
    def _ordered(self) -> Region:
        for axis, low, high in zip("xyz", self.min, self.max, strict=True):
            if low > high:
                raise BadValueError(f"the box is empty: min {low:g} m is above max {high:g} m in {axis}", "swap them")
        return self


class Task(Spec):
    """A task at one place: where the tool point goes, along which direction, and which spread is minimised.

    ``direction`` and ``tool_axis`` are directions in the world and in the tool frame. Without ``position`` and
    ``region`` the workpiece may stand anywhere in reach. With ``features`` the task is done at each of them, and
    ``direction`` is in the frame of the workpiece.

    Example:
        >>> import posture_opt as po
        >>> task = po.load_problem("insert_ur10").task
        >>> task.kind, task.position, task.clearance
        ('insert', (0.7, 0.2, 0.1), 0.0005)
    """

    within: ClassVar[Within]
    """The part of the spread that counts: across the direction, along it, or all of it."""
    axis: ClassVar[Literal["aligned", "required", "free"]]
    """Tool axis along the direction: where the arm can, always (else an error), or not asked for."""
    summary: ClassVar[str]
    """One line for ``optimize-posture list``."""
    touches: ClassVar[bool] = True
    """Whether the tool touches its target: programs come to it and leave it on a line."""
    direction_name: ClassVar[str] = "task direction"
    """What reports and figures call ``direction``: the spread is across or along it."""

    kind: str
    frame: Literal["world", "robot"] = Field("world", description="of direction and places: world, or the robot's base")
    direction: Direction = Field((0.0, 0.0, -1.0), description="of insertion, of the feed, of touch; world")
    position: tuple[Length, Length, Length] | None = Field(None, description="of the target, world")
    region: Region | None = Field(None, description="where the target may stand, in place of `position`")
    workpiece: Workpiece | None = Field(None, description="pose of the frame that features or a path stand in")
    features: Features = Field((), description="places of the workpiece that are all served in one placement")
    combine: Combine = Field("worst", description="the worst feature, their mean, or the probability of all")
    tool_axis: Direction = Field((0.0, 0.0, 1.0), description="of the tool, laid along `direction`; tool frame")
    tilt: Annotated[Angle, Field(ge=0, le=math.pi / 2)] = Field(
        0.0, description="by how much the tool axis may lean from `direction`"
    )
    clearance: Annotated[Length, Field(gt=0)] | None = Field(
        None, description="radial play of the hole: gives the probability"
    )
    criterion: Criterion = "worst"
    ordinary: Annotated[Share, Field(ge=0, lt=1)] = Field(
        0.03, description="share that an ordinary posture of one target may be worse and come first; 0: never"
    )
    minimize: tuple[TermSpec, ...] = Field((), description="terms to minimise beside it, with weights")
    subject_to: tuple[TermSpec, ...] = Field((), description="terms to keep within bounds")
    payload: Mass | None = Field(None, ge=0, description="carried in the task, for effects that depend on it")
    approach: dict[str, Literal[-1, 1]] = Field(
        {}, description="JOINT: 1 where its value is increasing on arrival, -1 where it is decreasing"
    )
    temperature: Celsius | None = Field(None, description="at which the task is done, for effects of it")
    time: Time | None = Field(None, ge=0, description="of the task since the first measurement, for effects of time")

    @property
    def on_path(self) -> bool:
        """Whether it is done along a path, at one posture a point."""
        return False

    def direction_at(self, point: tuple[float, float, float]) -> tuple[float, float, float]:
        """The direction that the spread counts across (or along) where the tool is at ``point`` [m], world."""
        return self.direction

    @property
    def places(self) -> tuple[tuple[float, float, float], ...]:
        """Where on the workpiece the task is done [m], in its frame; empty where that is at one target."""
        return tuple(feature.position for feature in self.features)

    @property
    def origin(self) -> tuple[float, float, float]:
        """The workpiece's origin, about which its angle errs, in the frame that its features or points are in [m].

        The origin of that frame where the task has a ``workpiece``; else the middle of all features or points.
        """
        if self.workpiece is not None or not self.places:
            return (0.0, 0.0, 0.0)
        x, y, z = (sum(coordinate) / len(self.places) for coordinate in zip(*self.places, strict=True))
        return x, y, z

    def lever_at(self, point: tuple[float, float, float]) -> tuple[float, float, float]:
        """From the workpiece's origin to ``point`` [m], world, with the workpiece in the middle of its ranges.

        Zero at a single target, which is the origin itself unless the task has a ``workpiece``.
        """
        if self.workpiece is None and not self.places:
            return (0.0, 0.0, 0.0)
        x, y, z = (self.workpiece or Workpiece()).central(self.origin)
        return point[0] - x, point[1] - y, point[2] - z

    def for_robot(self, robot: Robot) -> Self:
        """The task in the world, with what the robot has for its terms: named postures, and bounds where none is
        stated."""
        if self.frame == "robot":
            placed = self.model_copy(update={"frame": "world", **self.in_frame(product_of(robot.base))})
            return placed.for_robot(robot)
        terms = {"minimize": self.minimize, "subject_to": self.subject_to}
        found = {key: tuple(t.for_robot(robot, key == "subject_to") for t in given) for key, given in terms.items()}
        return self if found == terms else self.model_copy(update={k: v for k, v in found.items() if v != terms[k]})

    def in_frame(self, T: Array) -> dict[str, object]:
        """The fields that hold directions and places, seen from where their frame has the pose T (4, 4) [m]."""
        of_world = {"region": self.region, "workpiece": self.workpiece, "yaw": self.heading}
        if np.max(np.abs(T[:3, :3] - np.eye(3))) > 1e-9 and any(of_world.values()):
            key = next(key for key, value in of_world.items() if value)
            message = f"the base of the robot is turned in the world, and {key} is along the axes of the world"
            raise InputError(Issue(message, ("task", "frame"), "robot", f"state {key} in the world, or a position"))
        R, p = T[:3, :3], T[:3, 3]
        found: dict[str, object] = {"direction": seen_from(R, self.direction)}
        if self.position is not None:
            found["position"] = seen_from(R, self.position, p)
        if self.region is not None:
            ends = {"min": self.region.min, "max": self.region.max}
            found["region"] = self.region.model_copy(update={key: seen_from(R, end, p) for key, end in ends.items()})
        if self.workpiece is not None:
            spans = zip("xyz", p.tolist(), strict=True)
            moved = {axis: tuple(end + by for end in getattr(self.workpiece, axis)) for axis, by in spans}
            found["workpiece"] = self.workpiece.model_copy(update=moved)
        else:
            found["features"] = tuple(
                f.model_copy(
                    update={
                        "position": seen_from(R, f.position, p),
                        "direction": None if f.direction is None else seen_from(R, f.direction),
                    }
                )
                for f in self.features
            )
        return found

    @property
    def axis_request(self) -> Literal["aligned", "required", "free"]:
        """What is asked of the tool axis: ``axis``, unless the values of the task change it."""
        return self.axis

    @property
    def part(self) -> HeldPart | None:
        """The part in the tool whose two ends count; None where the tool point alone counts."""
        return None

    @property
    def heading(self) -> Direction | None:
        """Where the x axis of the tool is to point, world, across a tool axis that is held; None: the spin is free."""
        return None

    @property
    def yaw_lever(self) -> float:
        """Lever [m] on which the yaw about the direction counts beside the shift across it; zero: it does not."""
        return 0.0

    @property
    def uses_yaw(self) -> bool:
        """Whether reports state the spread of the yaw."""
        return False

    @property
    def expansion(self) -> float | None:
        """Coverage factor k of the expanded uncertainty that reports state; None where none is asked for."""
        return None

    @field_validator("position", mode="before")
    @classmethod
    def _three(cls, value: object, info: ValidationInfo) -> object:
        if isinstance(value, list | tuple) and len(value) != 3:
            message = f"a position has three coordinates, {len(value)} are given"
            raise BadValueError(message, "write [0.6 m, 0.2 m, 0.1 m]")
        return value

    @model_validator(mode="after")
    def _one_target(self) -> Task:
        if self.position is not None and self.region is not None:
            raise BadValueError("position and region are both given", "keep one of them")
        if "ordinary" in self.model_fields_set and (self.features or self.on_path):
            raise BadValueError("ordinary postures are preferred at one target only", "leave out ordinary")
        if self.criterion == "miss" and not self._all_have_clearance:
            raise BadValueError("criterion miss needs the clearance of the hole", "add for example clearance: 0.2 mm")
        if self.criterion == "none" and not self.minimize:
            hint = "add for example minimize: [{kind: manipulability}]"
            raise BadValueError("criterion none leaves nothing to minimise", hint)
        if self.criterion == "miss" and self.within == "all":
            raise BadValueError(f"criterion miss asks about a hole and task {self.kind} has none", "use worst or trace")
        return self

    @model_validator(mode="after")
    def _parts_of_a_workpiece(self) -> Task:
        if "features" in self.model_fields_set and not self.features:
            raise BadValueError("features is an empty list", "name the places, or leave the key out")
        if self.features and (self.position is not None or self.region is not None):
            word = "position" if self.position is not None else "region"
            raise BadValueError(f"features and {word} are both given", "keep one of them: features have positions")
        if self.workpiece is not None and not self.on_workpiece:
            hint = "add features: [{name: hole 1, position: [30 mm, 0 m, 0 m]}]"
            raise BadValueError("the workpiece has neither features nor a path", hint)
        if "combine" in self.model_fields_set and not self.features:
            raise BadValueError("combine says how features count together and there are none", "add features: [...]")
        return self._combinable()

    def _combinable(self) -> Task:
        if self.combine == "success":
            if self.within == "all":
                raise BadValueError(f"task {self.kind} has no hole to succeed at", "use combine: worst or mean")
            if self.part is not None:
                hint = "use combine: worst, or leave out the length"
                raise BadValueError("combine: success does not know the length of a peg", hint)
            if not self._all_have_clearance:
                bare = next(feature.name for feature in self.features if feature.clearance is None)
                hint = "add for example clearance: 0.2 mm to the task, or to every feature"
                raise BadValueError(f"combine: success needs a clearance, and '{bare}' has none", hint)
            if "criterion" in self.model_fields_set and self.criterion != "miss":
                message = f"combine: success makes no use of criterion: {self.criterion}"
                raise BadValueError(message, "leave the criterion out")
        if self.combine == "mean" and self.criterion == "miss":
            raise BadValueError("probabilities to miss have no mean that matters", "write combine: success instead")
        return self

    @property
    def on_workpiece(self) -> bool:
        """Whether it names features, or a path, that stand in the frame of a workpiece."""
        return bool(self.features)

    @property
    def _all_have_clearance(self) -> bool:
        if self.clearance is not None:
            return True
        return bool(self.features) and all(feature.clearance is not None for feature in self.features)
