"""The header of a table of measurements: which column is what, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from posture_opt.errors import BadValueError, nearest
from posture_opt.measurements.table import Faults
from posture_opt.robot.robot import Robot
from posture_opt.units import DIMENSIONS, parse_quantity

AXES = ("x", "y", "z")
QUATERNION = ("qw", "qx", "qy", "qz")
LABELS = ("pose", "goal", "target", "robot", "point")
_INPUTS = {"payload": "mass", "temperature": "temperature", "time": "time"}
_UNITS = {"angle": "deg", "length": "mm", "mass": "kg", "temperature": "degC", "time": "s"}
_HEAD = re.compile(r"^\s*(?P<name>[^\[\]]*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?\s*$")
_CELSIUS = {"degC": 0.0, "°C": 0.0, "K": -273.15}

Kind = Literal["number", "label", "side"]


@dataclass(frozen=True)
class Column:
    """One column: a value is ``factor * cell + offset``, in SI units, radians or degC."""

    name: str
    index: int
    kind: Kind
    factor: float = 1.0
    offset: float = 0.0
    unit: str = ""


def dimensions(robot: Robot) -> dict[str, str]:
    """Every column that has a unit, with its dimension: joints, coordinates, inputs of effects."""
    joints = {joint.name: "angle" if joint.type == "revolute" else "length" for joint in robot.joints}
    return {**dict.fromkeys(AXES, "length"), **_INPUTS, **joints}


def read_header(heads: Sequence[str], robot: Robot, line: int, faults: Faults) -> dict[str, Column]:
    """The known columns by name; unknown, missing, doubled or unitless ones join ``faults``."""
    sized = dimensions(robot)
    kinds: dict[str, Kind] = dict.fromkeys((*sized, *QUATERNION), "number")
    kinds |= dict.fromkeys(LABELS, "label")
    kinds |= {f"{name}.approach": "side" for name in robot.joint_names}
    _clashes(robot, faults)
    found: dict[str, Column] = {}
    unknown: list[str] = []
    for index, head in enumerate(heads):
        match = _HEAD.match(head)
        name, unit = (match["name"], match["unit"]) if match else (head.strip(), None)
        if name not in kinds:
            unknown.append(name)
            continue
        if name in found:
            faults.add("two columns have this name", name, mend="keep one", line=line)
            continue
        factor, offset = _scale(name, unit, sized.get(name, ""), line, faults)
        found[name] = Column(name, index, kinds[name], factor, offset, (unit or "").strip())
    meant = _unknown(unknown, kinds, found, robot, line, faults)
    _missing(found, meant, robot, line, faults)
    return found


def _clashes(robot: Robot, faults: Faults) -> None:
    taken = {*AXES, *QUATERNION, *LABELS, *_INPUTS}
    for name in robot.joint_names:
        if name in taken:
            faults.add("a joint has the name of a column of measurements", name, mend="rename the joint in the problem")


def _scale(name: str, unit: str | None, dimension: str, line: int, faults: Faults) -> tuple[float, float]:
    """Factor and offset of a column; a wrong or missing unit is a fault, and the cells are still read."""
    text = (unit or "").strip()
    if not dimension:
        if text not in ("", "-", "1"):
            faults.add(f"a column without dimension has the unit '{text}'", name, text, f"write {name}", line)
        return 1.0, 0.0
    mend = f"write {name} [{_UNITS[dimension]}]"
    if not text:
        faults.add("the column has no unit", name, None, mend, line)
    elif dimension == "temperature":
        if text in _CELSIUS:
            return 1.0, _CELSIUS[text]
        faults.add(f"'{text}' is not a unit of temperature", name, text, mend, line)
    elif text == DIMENSIONS[dimension][0]:  # needs no table of units
        return 1.0, 0.0
    else:
        try:
            return parse_quantity(f"1 {text}", dimension), 0.0
        except BadValueError as error:
            faults.add(error.message, name, text, mend, line)
    return 1.0, 0.0


def _unknown(
    unknown: list[str], kinds: dict[str, Kind], found: dict[str, Column], robot: Robot, line: int, faults: Faults
) -> set[str]:
    """Complains about unknown columns; the names that they were probably meant to be."""
    free = [name for name in kinds if name not in found]
    near = {name: nearest(name, free) for name in unknown}
    joints = set(robot.joint_names)
    alike = {name.lower() for name in joints} & {name.lower() for name in unknown}
    if len(unknown) >= len(joints) > 1 and not joints & set(found) and not alike:
        ours, theirs = ", ".join(robot.joint_names), ", ".join(unknown[:20])
        message = f"no column is a joint of the problem's robot ({ours}), but there are {theirs}"
        mend = "is it another robot's file? name its problem file, or give the columns this robot's joint names"
        faults.add(message, mend=mend, line=line)
        return {*joints, *near.values()}
    for name in unknown:
        if not name:
            faults.add("a column has no name", mend="name it, or leave out the commas at the ends of lines", line=line)
            continue
        mend = f"did you mean '{near[name]}'?" if near[name] else f"known are {', '.join(kinds)}"
        faults.add("unknown column", name, name, mend, line)
    return set(near.values())


def _missing(found: dict[str, Column], meant: set[str], robot: Robot, line: int, faults: Faults) -> None:
    there = {*found, *meant}
    for joint in robot.joints:
        if joint.name not in there:
            unit = "deg" if joint.type == "revolute" else "mm"
            faults.add("the column of this joint is missing", joint.name, mend=f"add {joint.name} [{unit}]", line=line)
    measured = [axis for axis in AXES if axis in there]
    if "point" in found and measured:
        message = f"both point and {', '.join(measured)} are given"
        mend = "point takes the place of x, y, z where no instrument measures; leave out one of the two"
        faults.add(message, "point", mend=mend, line=line)
    if not measured and "point" not in there:
        faults.add("nothing is measured", mend="add x [mm], y [mm], z [mm], or point for touched points", line=line)
    turned = [name for name in QUATERNION if name in there]
    if turned and len(turned) < 4:
        lacking = ", ".join(name for name in QUATERNION if name not in there)
        faults.add(f"the quaternion lacks {lacking}", turned[0], mend="give all of qw, qx, qy, qz or none", line=line)
