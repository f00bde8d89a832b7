"""The ``data`` section of a problem file: how the files of an instrument are written, and known distances."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from posture_opt.errors import BadValueError
from posture_opt.measurements.camera_section import CameraSpec, MarkersSpec
from posture_opt.measurements.kinds import AnchorSpec, PairSpec, PlaneSpec
from posture_opt.spec import Spec
from posture_opt.units import JointValue, Length

# Two touched points and their known distance [m]
Distance = Annotated[tuple[str, str, Length], Field(examples=[["front/0", "front/1", "50 mm"]])]
ColumnHeader = Annotated[str | Annotated[int, Field(ge=1)], Field(examples=["Pos X [mm]"])]


class DataSpec(Spec):
    """What is known about the measurements besides their file: its columns, its numbers, distances of touched points.

    ``columns`` says under which column header, or in which column counted from 1, a known column is in the files of the
    instrument; ``units`` are those of columns whose headers have none. Where ``columns`` is given, unknown columns of
    the file are left out. ``repeats`` says whether the arm left its posture between rows of one posture that follow
    each other; where it is not stated, they show scatter of a joint, but not its absence.
    """

    distances: tuple[Distance, ...] = Field((), description="[point, point, distance with its unit]")
    planes: dict[str, PlaneSpec] = Field({}, description="plane that the ball touches: what is known of it")
    anchors: dict[str, AnchorSpec] = Field({}, description="anchor of distances: what is known of the lengths to it")
    frame: Literal["camera"] | None = Field(
        None, description="camera: poses (x, y, z, orientation) are those of a board that a camera on the tool reports"
    )
    orientation: Literal["rpy", "intrinsic_xyz", "abc", "wpr", "zyz", "rotation_vector", "matrix"] | None = Field(
        None,
        description="how the orientation columns are read: rpy, wpr (FANUC): about fixed x, y, z; abc (KUKA): about "
        "z, y', x''; where left out, as their names say",
    )
    direction: Literal["as_named", "inverted"] = Field(
        "as_named", description="inverted: every pose is the other way round, as base in tool, or camera in board"
    )
    joint_zeros: dict[str, JointValue] = Field(
        {}, description="joint: its number in the file where the joint of the robot is at zero"
    )
    joint_signs: dict[str, Literal[-1, 1]] = Field(
        {}, description="joint: -1 where its numbers in the file count in the opposite direction"
    )
    cameras: dict[str, CameraSpec] = Field({}, description="camera: where it is mounted, and its intrinsics")
    markers: dict[str, MarkersSpec] = Field({}, description="board: where it is mounted, and its points")
    pairs: dict[str, PairSpec] = Field(
        {}, description="second arm, whose tool touches: its problem file; columns ARM.JOINT are its joints"
    )
    columns: dict[str, ColumnHeader] = Field(
        {},
        description="known column: column header in the file, or number of the column from 1",
        examples=[{"x": "Pos X [mm]"}],
    )
    units: dict[str, str] = Field(
        {}, description="known column: unit, where its column header has none", examples=[{"x": "mm", "joint1": "deg"}]
    )
    decimal: Literal[".", ","] | None = Field(None, description="decimal mark, where the file leaves it open")
    thousands: Literal[".", ",", "'", " "] | None = Field(None, description="mark between groups of three digits")
    repeats: Literal["readings", "visits"] | None = Field(
        None,
        description="rows of one posture that follow each other: readings of one stay, or visits that the arm left",
    )

    @field_validator("distances")
    @classmethod
    def _between_two_points(cls, distances: tuple[tuple[str, str, float], ...]) -> tuple[tuple[str, str, float], ...]:
        seen: set[frozenset[str]] = set()
        for a, b, length in distances:
            if a == b:
                raise BadValueError(f"the distance of '{a}' to itself is given", "name two different points")
            if length <= 0:
                raise BadValueError(f"the distance of '{a}' and '{b}' is {length:g} m", "a distance is greater than 0")
            if frozenset((a, b)) in seen:
                raise BadValueError(f"the distance of '{a}' and '{b}' is given twice", "keep one")
            seen.add(frozenset((a, b)))
        return distances

    @field_validator("columns")
    @classmethod
    def _each_header_once(cls, columns: dict[str, str | int]) -> dict[str, str | int]:
        titles = list(columns.values())
        for name, title in columns.items():
            if titles.count(title) > 1:
                raise BadValueError(f"two columns are said to be under {title!r}, {name} one of them", "keep one")
        return columns

    @model_validator(mode="after")
    def _two_marks(self) -> DataSpec:
        if self.decimal is not None and self.decimal == self.thousands:
            raise BadValueError(f"'{self.decimal}' cannot be both decimal mark and mark of thousands", "keep one")
        return self


NOTHING_STATED = DataSpec()
