"""``workpiece`` and ``features`` of a task: where a part is, as far as that is free, and what is done at it.

The placement is ``T_world_workpiece = Trans(x, y, z) Rz(yaw)``: a part lies on its bench, so it has four coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from posture_opt.collision.obstacles.mesh import DEFAULT_BOXES, BoxCount, Mesh, MeshUnit
from posture_opt.errors import BadValueError
from posture_opt.limits import MOST_FEATURES
from posture_opt.spec import Spec
from posture_opt.units import DIMENSIONS, Length, parse_quantity

# The largest spread of the features, their mean, or the probability that all of them succeed.
Combine = Literal["worst", "mean", "success"]

Point = tuple[float, float, float]

WORKPIECE = "workpiece"  # name of the part in reports and pictures


def _span(dimension: str) -> Any:
    """The type of a value, or [least, most]: always kept as two numbers [SI], equal where the value is fixed."""
    example = DIMENSIONS[dimension][1]

    def read(value: object) -> tuple[float, float]:
        if not isinstance(value, list | tuple):
            fixed = parse_quantity(value, dimension)
            return fixed, fixed
        if len(value) != 2:
            given = f"{len(value)} {'is' if len(value) == 1 else 'are'} given"
            hint = f"write one value, or [least, most], for example [-{example}, {example}]"
            raise BadValueError(f"a range has two ends, {given}", hint)
        low, high = (parse_quantity(end, dimension) for end in value)
        if low > high:
            raise BadValueError(f"the range [{value[0]}, {value[1]}] is empty: least above most", "swap them")
        return low, high

    text = {"type": "string", "description": f"{dimension} with its unit", "examples": [example]}
    schema = {"anyOf": [text, {"type": "array", "items": text, "minItems": 2, "maxItems": 2}], "examples": [example]}
    return Annotated[tuple[float, float], BeforeValidator(read), WithJsonSchema({**schema, "dimension": dimension})]


if TYPE_CHECKING:
    LengthSpan = tuple[float, float]
    AngleSpan = tuple[float, float]
else:
    LengthSpan = _span("length")
    AngleSpan = _span("angle")


class Workpiece(Spec):
    """The pose ``T_world_workpiece = Trans(x, y, z) Rz(yaw)`` of the frame that features (or a path) are in.

    Each coordinate is one value, which is fixed, or ``[least, most]``, within which it is chosen together with the
    postures.
    """

    x: LengthSpan = Field((0.0, 0.0), description="of its origin in the world: a value, or `[least, most]`")
    y: LengthSpan = Field((0.0, 0.0), description="as `x`")
    z: LengthSpan = Field((0.0, 0.0), description="as `x`")
    yaw: AngleSpan = Field((0.0, 0.0), description="its turn about the vertical: a value, or `[least, most]`")
    file: str | None = Field(
        None,
        description="STL, OBJ, PLY or OFF file of the part in its frame: drawn, and kept clear of where it is fixed",
    )
    unit: MeshUnit | None = Field(None, description="of the lengths in the file")
    boxes: BoxCount = Field(DEFAULT_BOXES, description="at most so many boxes enclose it")

    @model_validator(mode="after")
    def _with_unit(self) -> Workpiece:
        if self.file is not None and self.unit is None:
            raise BadValueError("the unit of the lengths in the file is missing", "add unit: mm")
        if self.file is None and self.unit is not None:
            raise BadValueError("unit says how the lengths in a file are written, and there is no file", "add file: …")
        return self

    def in_folder(self, folder: Path) -> Workpiece:
        """The workpiece with the whole path of its file, which is read."""
        if self.file is None:
            return self
        return self.model_copy(update={"file": self._mesh(self.lower).in_folder(folder).file})

    @property
    def fixed(self) -> bool:
        return self.lower == self.upper

    @property
    def shape_keys(self) -> dict[str, str | int | None]:
        """The keys of its shape, as a file has them; none without a shape."""
        return {} if self.file is None else {"file": self.file, "unit": self.unit, "boxes": self.boxes}

    @property
    def notes(self) -> tuple[str, ...]:
        """How its shape is checked, in a sentence; nothing without one."""
        solid = self.solid(self.lower)
        if solid is None:
            return ()
        where = "" if self.fixed else "; its placement is chosen without looking at it, and checked after that"
        return (f"{solid.note}{where}",)

    def solid(self, w: Sequence[float]) -> Mesh | None:
        """The part as an obstacle at w = (x, y, z [m], yaw [rad]), or None without a file."""
        return None if self.file is None else self._mesh(w)

    def _mesh(self, w: Sequence[float]) -> Mesh:
        """The part at a placement (4,)."""
        x, y, z, yaw = map(float, w)
        keys = {"name": WORKPIECE, "kind": "mesh", **self.shape_keys}
        return Mesh.model_validate(keys).model_copy(update={"xyz": (x, y, z), "rpy": (0.0, 0.0, yaw)})

    @property
    def lower(self) -> tuple[float, float, float, float]:
        """The least of x, y, z [m] and yaw [rad]."""
        return self.x[0], self.y[0], self.z[0], self.yaw[0]

    @property
    def upper(self) -> tuple[float, float, float, float]:
        """The most of x, y, z [m] and yaw [rad]."""
        return self.x[1], self.y[1], self.z[1], self.yaw[1]

    def central(self, point: Point) -> Point:
        """A point of the workpiece [m] in the world, with the workpiece in the middle of its ranges."""
        x, y, z, yaw = ((low + high) / 2 for low, high in zip(self.lower, self.upper, strict=True))
        c, s = math.cos(yaw), math.sin(yaw)
        return x + c * point[0] - s * point[1], y + s * point[0] + c * point[1], z + point[2]


class Feature(Spec):
    """One place of the workpiece at which the task is done: position [m] and direction, in the frame of the workpiece.

    Its direction turns with the workpiece; that of the task does so too where a feature states none.
    """

    name: Annotated[str, Field(min_length=1, description="in reports, unique", examples=["hole 1"])]
    position: tuple[Length, Length, Length] = Field(description="in the frame of the workpiece")
    direction: Direction | None = Field(None, description="default: that of the task")
    clearance: Annotated[Length, Field(gt=0)] | None = Field(None, description="default: that of the task")


def _distinct(features: tuple[Feature, ...]) -> tuple[Feature, ...]:
    names = [feature.name for feature in features]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BadValueError(f"two features have the name '{twice[0]}'", "give each a name of its own")
    MOST_FEATURES.check(len(features))
    return features


Features = Annotated[tuple[Feature, ...], AfterValidator(_distinct)]


def _nonzero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*vector) < 1e-12:
        raise BadValueError("a direction of length zero points nowhere", "write for example [0, 0, -1]")
    return vector


Direction = Annotated[tuple[float, float, float], AfterValidator(_nonzero)]
