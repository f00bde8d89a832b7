"""What every robot format shares: the keys of the ``robot:`` section and the step to a ``Robot``."""

from __future__ import annotations

import csv
import math
import re
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, ValidationError, ValidationInfo, WithJsonSchema, field_validator, model_validator

from posture_opt.errors import BadValueError, InputError, Issue, as_given
from posture_opt.files import located, named_content
from posture_opt.limits import MOST_JOINTS
from posture_opt.numerics import TURN
from posture_opt.robot.corrections import corrected, with_velocities
from posture_opt.robot.robot import Factor, Joint, Robot, frame_factors
from posture_opt.robot.shape_section import ShapeSpec, shaped
from posture_opt.spec import Spec, WordOrSection
from posture_opt.units import Angle, JointVelocity, Length, Mass, Quantity, parse_quantity

FULL_TURN = (-TURN, TURN)  # Limits of a revolute joint for which none are stated [rad]
_RESERVED = {"base", "tool"}  # Names that no joint may have: these frames own the parameters base.x … tool.yaw
_LIMITS_SCHEMA = WithJsonSchema(
    {
        "type": "array",
        "items": {"type": ["string", "number"]},
        "minItems": 2,
        "maxItems": 2,
        "description": "lower and upper limit: angles (revolute) or lengths (prismatic)",
        "examples": [["-180 deg", "180 deg"], ["0 mm", "210 mm"]],
    }
)


def check_joint_name(name: str) -> None:
    """Refuse a name that cannot build ``JOINT.theta``, of which the last dot ends the name, or the header ``JOINT
    [deg]``."""
    if not name or name != name.strip():
        raise BadValueError(f"a joint name must not be empty or begin or end with a blank: '{name}'")
    bad = sorted(set(name) & set("[],:\n\t"))
    if bad:
        message = f"the joint name '{name}' holds {' '.join(map(repr, bad))}"
        raise BadValueError(message, "use letters, digits, '_', '-' and '.'")
    if name in _RESERVED:
        raise BadValueError(f"the joint name '{name}' is taken by the {name} frame", "choose another")


class FrameSpec(WordOrSection):
    """A fixed frame, ``T = Trans(x, y, z) Rz(yaw) Ry(pitch) Rx(roll)``; ``free``: to be found from the data."""

    word: ClassVar[str] = "free"
    meaning: ClassVar[Mapping[str, object]] = {"free": True}
    noun: ClassVar[str] = "frame"
    example: ClassVar[str] = "{xyz: [0 m, 0 m, 0 m], rpy: [0 deg, …]}"

    xyz: tuple[Length, Length, Length] = Field(
        (0.0, 0.0, 0.0), description="origin: of `base` in the world, of `tool` in the flange"
    )
    rpy: tuple[Angle, Angle, Angle] = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw about fixed axes, in this order"
    )
    free: bool = Field(False, description="found from measurements; the numbers are where the fit starts")

    def factors(self, prefix: Literal["base", "tool"]) -> tuple[Factor, ...]:
        """The six named factors ``prefix.x`` … ``prefix.roll`` of the frame."""
        return frame_factors(prefix, self.xyz, self.rpy)


class ToolSpec(FrameSpec):
    """The tool point in the flange, and how thick the tool is."""

    radius: Annotated[Length, Field(gt=0)] | None = Field(
        None, description="of the capsule from the flange to the tool point, for collision checks"
    )


class JointSpec(Spec):
    """One row of a Denavit-Hartenberg table, with the limits and the rigid link behind the joint.

    ``limits`` are angles of a revolute and lengths of a prismatic joint; a revolute joint may leave them out
    (a turn either way). ``com`` [m] is given in the frame behind the joint.
    """

    name: str = Field(description="in reports, parameters (`NAME.theta`) and columns of measurements; unique")
    type: Literal["revolute", "prismatic"] = Field(
        "revolute", description="what the joint does about, or along, its z axis"
    )
    a: Length = Field(0.0, description="length along x")
    alpha: Angle = Field(0.0, description="twist about x")
    d: Length = Field(0.0, description="length along z; of a prismatic joint added to its value")
    theta: Angle = Field(0.0, description="angle about z; of a revolute joint added to its value")
    # (2,) lower and upper limit of the joint variable [rad or m]
    limits: Annotated[tuple[float, float], _LIMITS_SCHEMA] = Field(FULL_TURN, validate_default=True)
    mass: Mass = Field(math.nan, description="of the link behind the joint; unknown where it is left out")
    com: tuple[Length, Length, Length] = Field(
        (math.nan, math.nan, math.nan), description="centre of mass of that link, in the frame behind the joint"
    )
    gear_ratio: float = Field(math.nan, description="motor turns per turn of the joint, for ripple")

    @field_validator("name")
    @classmethod
    def _usable_name(cls, name: str) -> str:
        check_joint_name(name)
        return name

    @field_validator("limits", mode="before")
    @classmethod
    def _read_limits(cls, value: object, info: ValidationInfo) -> object:
        kind = info.data.get("type")
        if value is FULL_TURN and kind == "prismatic":
            raise BadValueError("a prismatic joint needs its limits", "write for example limits: [0 mm, 210 mm]")
        if value is FULL_TURN or kind is None:  # an unknown type has its own error already
            return FULL_TURN
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise BadValueError(f"{as_given(value)} where two limits belong", "write for example [-180 deg, 180 deg]")
        lower, upper = (parse_quantity(v, "angle" if kind == "revolute" else "length") for v in value)
        if not lower < upper:
            raise BadValueError("the limits are crossed or leave no range", "write [lower, upper] with lower < upper")
        return lower, upper

    @field_validator("mass")
    @classmethod
    def _mass_not_negative(cls, mass: float) -> float:
        if mass < 0:
            raise BadValueError(f"a mass is not negative (here {mass:g} kg)")
        return mass

    @field_validator("gear_ratio")
    @classmethod
    def _ratio_not_zero(cls, ratio: float) -> float:
        if ratio == 0:
            raise BadValueError("a gear ratio is not zero", "leave it out where it is unknown")
        return ratio

    def joint(self) -> Joint:
        """The joint in numbers [SI], without the geometry of its row."""
        lower, upper = self.limits
        return Joint(self.name, self.type, lower, upper, self.mass, self.com, self.gear_ratio)

    def driven(self, index: int, symbol: Literal["theta", "d"]) -> Factor:
        """The factor about or along z with ``theta`` or ``d``, and with the joint variable q[index] if it moves."""
        moves = (symbol == "theta") == (self.type == "revolute")
        kind: Literal["rotate", "translate"] = "rotate" if symbol == "theta" else "translate"
        return Factor(kind, 2, getattr(self, symbol), f"{self.name}.{symbol}", index if moves else None)


class RobotFormat(Spec):
    """The ``robot:`` section of a problem file; each format adds its own keys and says how it becomes a ``Robot``."""

    base: FrameSpec = Field(FrameSpec(), description="base in the world; `free`: found from measurements")
    tool: ToolSpec = Field(
        ToolSpec(), description="tool point in the flange (`free`: found from measurements), radius of the tool"
    )
    payload: Mass = Field(0.0, description="mass at the tool point, for torque and compliance")
    gravity: tuple[float, float, float] = Field((0.0, 0.0, -9.81), description="m/s², world")
    corrections: dict[str, Quantity] = Field({}, description="PARAMETER: what is added to its nominal value")
    velocity: dict[str, JointVelocity] = Field({}, description="JOINT: its largest speed, for the time along a path")
    shape: ShapeSpec | None = Field(None, description="capsules that base, links and tool lie in, for collision checks")

    @field_validator("payload")
    @classmethod
    def _payload_not_negative(cls, payload: float) -> float:
        if payload < 0:
            raise BadValueError(f"a payload is not negative (here {payload:g} kg)")
        return payload

    def build(self, folder: Path) -> Robot:
        """The chain in numbers, its parameters corrected."""
        return corrected(self.nominal(folder), self.corrections)

    @abstractmethod
    def nominal(self, folder: Path) -> Robot:
        """The chain in numbers as the format gives it, without the corrections."""

    def assemble(self, name: str, joints: tuple[Joint, ...], links: tuple[tuple[Factor, ...], ...]) -> Robot:
        """A ``Robot`` of joints and links (n,) between base and tool of this section, with its shape and velocities."""
        return with_velocities(shaped(self.bare(name, joints, links), self.shape), self.velocity)

    def bare(self, name: str, joints: tuple[Joint, ...], links: tuple[tuple[Factor, ...], ...]) -> Robot:
        """`assemble` without shape and velocities."""
        return Robot(
            name=name,
            joints=joints,
            links=links,
            base=self.base.factors("base"),
            tool=self.tool.factors("tool"),
            payload=self.payload,
            gravity=self.gravity,
            base_free=self.base.free,
            tool_free=self.tool.free,
            tool_radius=self.tool.radius,
        )


def check_payload(robot: Robot) -> None:
    """Refuses a payload that no arm of this mass carries."""
    if robot.payload > robot.most_payload:
        message, hint = f"no arm like this one carries {robot.payload:g} kg", "is it in grams?"
        raise InputError(Issue(message, ("payload",), hint=hint))


class TableRobot(RobotFormat):
    """A robot given by one table row a joint: the base of both Denavit-Hartenberg conventions."""

    joints: tuple[JointSpec, ...] = Field((), description="rows of the table, from base to tool")
    file: str | None = Field(None, description="CSV with the rows in place of `joints`: name, a [mm], alpha [deg], …")

    @field_validator("joints")
    @classmethod
    def _usable_table(cls, joints: tuple[JointSpec, ...]) -> tuple[JointSpec, ...]:
        names = [joint.name for joint in joints]
        if not names:
            raise BadValueError("a robot needs at least one joint")
        MOST_JOINTS.check(len(names))
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise BadValueError(f"joint names given twice: {', '.join(twice)}", "names must differ")
        return joints

    @model_validator(mode="after")
    def _one_table(self) -> TableRobot:
        if bool(self.joints) == (self.file is not None):
            raise BadValueError("a table is given by joints or by file, by one of them", "write joints: [{name: …}, …]")
        return self

    def nominal(self, folder: Path) -> Robot:
        """The chain in numbers, its frames beside its bodies."""
        if self.file is not None:
            rows = table_rows(folder, self.file)
            try:
                joints = type(self)(kind=self.kind, joints=rows).joints  # type: ignore[attr-defined, call-arg]
            except ValidationError as error:
                found = error.errors(include_url=False)
                issues = [Issue(e["msg"].removeprefix("Value error, "), e["loc"], file=self.file) for e in found]
                raise InputError(issues) from None
            return self.model_copy(update={"joints": joints, "file": None}).nominal(folder)
        links = tuple(self.row(joint, index) for index, joint in enumerate(self.joints))
        return self.assemble(
            f"{len(links)}-joint arm", tuple(joint.joint() for joint in self.joints), self.placed(links)
        )

    def placed(self, links: tuple[tuple[Factor, ...], ...]) -> tuple[tuple[Factor, ...], ...]:
        """The links of the table from frames that stand beside the arm."""
        return links

    @staticmethod
    @abstractmethod
    def row(joint: JointSpec, index: int) -> tuple[Factor, ...]:
        """The factors of one row of the table, whose joint variable is ``q[index]``."""


_MOST_BYTES = 1_000_000
_HEADER = re.compile(r"^\s*(?P<key>[A-Za-z_]+)\s*(?:\[(?P<unit>[^\]]*)\]|\((?P<braced>[^)]*)\))?\s*$")


def table_rows(folder: Path, file: str) -> list[dict[str, object]]:
    """What a section ``joints`` would state: columns ``name, type, a [mm], alpha [deg], d [mm], theta [deg], lower
    [deg], upper [deg]``, of which any but the name may be left out."""
    path = located(folder, file)
    text = named_content(path, _MOST_BYTES).decode("utf-8-sig", "replace")
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    separator = max(",;\t", key=(lines or [""])[0].count)
    header, *rows = [*csv.reader(lines, delimiter=separator)] or [[]]
    found = [_HEADER.match(title) for title in header]
    if not rows or not all(found) or any(len(row) != len(header) for row in rows):
        hint = "name, a [mm], alpha [deg], d [mm], theta [deg], lower [deg], upper [deg]"
        raise InputError(Issue("this is no table with one row a joint", hint=hint, file=str(path)))
    columns = [(match["key"].lower(), (match["unit"] or match["braced"] or "").strip()) for match in found if match]
    return [_joint(row, columns, number, separator) for number, row in enumerate(rows, 1)]


def _joint(row: list[str], columns: list[tuple[str, str]], number: int, separator: str) -> dict[str, object]:
    decimal = (lambda text: text.replace(",", ".")) if separator != "," else str
    stated: dict[str, object] = {"name": f"q{number}"}
    for (key, unit), cell in zip(columns, map(str.strip, row), strict=True):
        if cell:
            stated[key] = f"{decimal(cell)} {unit}" if unit else cell
    limits = [stated.pop(key) for key in ("lower", "upper") if key in stated]
    return {**stated, "limits": limits} if limits else stated
