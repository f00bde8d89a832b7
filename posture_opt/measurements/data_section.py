"""The ``data`` section of a problem file: how the files of an instrument are written, and known distances."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from posture_opt.errors import BadValueError
from posture_opt.spec import Spec
from posture_opt.units import Length

Distance = Annotated[tuple[str, str, Length], Field(examples=[["front/0", "front/1", "50 mm"]])]
ColumnHead = Annotated[str | Annotated[int, Field(ge=1)], Field(examples=["Pos X [mm]"])]


class DataSpec(Spec):
    """What is known about the measurements besides their file: its columns, its numbers, distances of touched points.

    ``columns`` says under which head, or in which column counted from 1, a known column stands in the files of the
    instrument; ``units`` are those of columns whose heads have none. Where ``columns`` is given, columns of the file
    that nobody knows are left out.
    """

    distances: tuple[Distance, ...] = Field((), description="[point, point, distance with its unit]")
    columns: dict[str, ColumnHead] = Field(
        {},
        description="known column: head in the file, or number of the column from 1",
        examples=[{"x": "Pos X [mm]"}],
    )
    units: dict[str, str] = Field(
        {}, description="known column: unit, where its head has none", examples=[{"x": "mm", "joint1": "deg"}]
    )
    decimal: Literal[".", ","] | None = Field(None, description="decimal mark, where the file leaves it open")
    thousands: Literal[".", ",", "'", " "] | None = Field(None, description="mark between groups of three digits")

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
    def _each_head_once(cls, columns: dict[str, str | int]) -> dict[str, str | int]:
        heads = list(columns.values())
        for name, head in columns.items():
            if heads.count(head) > 1:
                raise BadValueError(f"two columns are said to stand under {head!r}, {name} one of them", "keep one")
        return columns

    @model_validator(mode="after")
    def _two_marks(self) -> DataSpec:
        if self.decimal is not None and self.decimal == self.thousands:
            raise BadValueError(f"'{self.decimal}' cannot be both decimal mark and mark of thousands", "keep one")
        return self
