"""The columns of a table of measurements: what each is, in which unit, and its cells as numbers and codes."""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from posture_opt.errors import BadValueError, nearest
from posture_opt.measurements.table import Faults, RowBlock
from posture_opt.numerics import Array, Codes
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
_HUGE = 1e15  # in any unit; squares of larger numbers leave the range of floats sooner or later


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
    found, meant = known_columns(heads, robot, line, faults)
    _missing(found, meant, robot, line, faults)
    return found


def known_columns(heads: Sequence[str], robot: Robot, line: int, faults: Faults) -> tuple[dict[str, Column], set[str]]:
    """The known columns by name, and what unknown ones were probably meant to be; these, doubled or unitless ones join
    ``faults``, and nothing that is missing does.
    """
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
    return found, _unknown(unknown, kinds, found, robot, line, faults)


def _clashes(robot: Robot, faults: Faults) -> None:
    taken = {*AXES, *QUATERNION, *LABELS, *_INPUTS, *(f"{name}.approach" for name in robot.joint_names)}
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
    others = len(unknown) >= len(joints) or (len(unknown) > 1 and not joints & set(near.values()))
    if others and len(joints) > 1 and not joints & set(found) and not alike:
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
    incomplete_quaternion(there, line, faults)


def incomplete_quaternion(there: Container[str], line: int, faults: Faults) -> None:
    """Complains where only some of the four columns of the orientation are there."""
    turned = [name for name in QUATERNION if name in there]
    if turned and len(turned) < 4:
        lacking = ", ".join(name for name in QUATERNION if name not in there)
        faults.add(f"the quaternion lacks {lacking}", turned[0], mend="give all of qw, qx, qy, qz or none", line=line)


@dataclass
class Cells:
    """The columns read so far: numbers (N,) in SI units, codes (N,) with the texts they stand for."""

    lines: list[Codes] = field(default_factory=list)
    numbers: dict[str, list[Array]] = field(default_factory=dict)
    codes: dict[str, list[Codes]] = field(default_factory=dict)
    texts: dict[str, dict[str, int]] = field(default_factory=dict)

    @property
    def line(self) -> Codes:
        """(N,) the line of each row."""
        return np.concatenate(self.lines) if self.lines else np.zeros(0, dtype=np.intp)

    def number(self, name: str) -> Array | None:
        """(N,) the values of a column; ``None`` where there is none."""
        return np.concatenate(self.numbers[name]) if name in self.numbers else None

    def code(self, name: str) -> tuple[Codes, tuple[str, ...]] | None:
        """(N,) codes in the order of first appearance, and their texts; ``None`` where there is no such column."""
        return (np.concatenate(self.codes[name]), tuple(self.texts[name])) if name in self.codes else None


def read_cells(blocks: Iterable[RowBlock], columns: Iterable[Column], faults: Faults) -> Cells:
    """All rows of the known columns; cells that cannot be used join ``faults``, each with its line."""
    cells, known = Cells(), list(columns)
    for block in blocks:
        cells.lines.append(np.asarray(block.lines, dtype=np.intp))
        for column in known:
            texts = block.cells[column.index]
            if column.kind == "label":
                names = cells.texts.setdefault(column.name, {})
                cells.codes.setdefault(column.name, []).append(_labels(texts, block.lines, column, names, faults))
                continue
            values = _numbers(texts, block.lines, column, faults) * column.factor + column.offset
            cells.numbers.setdefault(column.name, []).append(values)
    return cells


def _labels(texts: Sequence[Any], lines: Sequence[int], column: Column, names: dict[str, int], faults: Faults) -> Codes:
    words = [_word(text) for text in texts]
    for word, line in zip(words, lines, strict=True) if "" in words else ():
        if not word:
            faults.add("the cell is empty", column.name, mend="name it, or leave out the column", line=line)
    return np.fromiter((names.setdefault(word, len(names)) for word in words), dtype=np.intp, count=len(words))


def _word(cell: Any) -> str:
    if isinstance(cell, str):
        return cell.strip()
    if isinstance(cell, float | np.floating):
        return "" if math.isnan(cell) else repr(float(cell)).removesuffix(".0")
    return "" if cell is None else str(cell)


def _numbers(texts: Sequence[Any], lines: Sequence[int], column: Column, faults: Faults) -> Array:
    """(N,) floats; NaN in a column of sides means that the row does not say."""
    optional = column.kind == "side"
    try:
        if not isinstance(texts, np.ndarray) and "_" in "".join(texts):  # float() would take 1_0 for ten
            raise ValueError
        kind = texts.dtype.kind if isinstance(texts, np.ndarray) else "U"
        if kind not in "fiuU":
            raise ValueError
        values = np.fromiter(map(float, texts), dtype=float, count=len(texts))
    except (ValueError, TypeError):
        values = np.full(len(texts), math.nan)
    bad = np.flatnonzero(~(np.abs(values) < _HUGE))
    for row in map(int, bad):
        values[row] = _number(texts[row], int(lines[row]), column, optional, faults)
    if optional:
        for row in map(int, np.flatnonzero(~np.isin(values, (-1.0, 1.0)) & ~np.isnan(values))):
            faults.add(f"{texts[row]} is no side", column.name, texts[row], "write 1 or -1", int(lines[row]))
    return values


def _number(cell: Any, line: int, column: Column, optional: bool, faults: Faults) -> float:
    """The number in one cell, found the slow way; 0 with a fault where there is none."""
    text = _word(cell)
    if not text or (optional and text.lower() == "nan"):
        if not optional:
            said = "is NaN" if isinstance(cell, float | np.floating) else "is empty"
            faults.add(f"the cell {said}", column.name, cell, "give a number, or leave out the row", line)
        return math.nan if optional else 0.0
    try:
        if "_" in text or isinstance(cell, bool | np.bool_):
            raise ValueError
        value = float(text)
        if abs(value) < _HUGE:
            return value
        message = f"{text[:40]} is {'larger than anything measured' if math.isfinite(value) else 'not a finite number'}"
    except ValueError:
        message = f"'{text[:40]}' is not a number"
    mend = "leave out the row"
    if optional:  # a side
        faults.add(f"'{text[:40]}' is no side", column.name, cell, "write 1 or -1", line)
        return math.nan
    if text[:1].isdigit() or text[:1] in "+-.":
        mend = "write a decimal point" if "," in text else "the unit stands in the header, the cell is a plain number"
    faults.add(message, column.name, cell, mend, line)
    return 0.0
