"""The header of a table of measurements: which column is what, in which unit, and what is missing or unknown."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches

from posture_opt.errors import BadValueError, Issue, listed, nearest, one_of
from posture_opt.measurements.columns import AXES, LABELS, Column, Kind
from posture_opt.measurements.data_section import DataSpec
from posture_opt.measurements.faults import Faults
from posture_opt.measurements.layout import HEAD, ROUND
from posture_opt.measurements.orientation_columns import QUATERNION, angle_columns, incomplete_orientation
from posture_opt.robot.robot import Robot
from posture_opt.units import DIMENSIONS, parse_quantity

_INPUTS = {"payload": "mass", "temperature": "temperature", "time": "time"}
_UNITS = {"angle": "deg", "length": "mm", "mass": "kg", "temperature": "degC", "time": "s"}
_SPELT_OUT = {"second": "s", "meter": "m", "millimeter": "mm", "degree": "deg", "radian": "rad", "kilogram": "kg"}
_CELSIUS = {"degC": 0.0, "°C": 0.0, "K": -273.15}
_MISTYPED = 0.8  # alikeness from which a column of a foreign file is a known one with a slip
_NAMED = 20  # columns of a foreign file that a message lists


def dimensions(robot: Robot) -> dict[str, str]:
    """Every column that has a unit, with its dimension: joints, coordinates, orientations, inputs of effects."""
    joints = {joint.name: "angle" if joint.type == "revolute" else "length" for joint in robot.joints}
    return {**dict.fromkeys(AXES, "length"), **dict.fromkeys(angle_columns(robot), "angle"), **_INPUTS, **joints}


def column_kinds(robot: Robot) -> dict[str, Kind]:
    """Every column that a file of this robot may have."""
    kinds: dict[str, Kind] = dict.fromkeys((*dimensions(robot), *QUATERNION), "number")
    kinds |= dict.fromkeys(LABELS, "label")
    return kinds | {f"{name}.approach": "side" for name in robot.joint_names}


def data_issues(spec: DataSpec, robot: Robot) -> list[Issue]:
    """Columns that the section ``data`` speaks of and that no file of this robot has; keys relative to the section."""
    known = column_kinds(robot)
    return [
        Issue("no file of this robot has such a column", (key, name), name, one_of(name, known, "known"))
        for key, given in (("columns", spec.columns), ("units", spec.units))
        for name in given
        if name not in known
    ]


@dataclass
class Header:
    """What was found in the heads: known columns, and what is wrong with the others."""

    found: dict[str, Column] = field(default_factory=dict)
    unknown: dict[str, str] = field(default_factory=dict)
    unitless: dict[str, str] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)

    @property
    def meant(self) -> set[str]:
        """Known names that unknown heads were probably meant to be."""
        return {name for name in self.unknown.values() if name}

    def tell(self, line: int, faults: Faults, kinds: dict[str, Kind]) -> None:
        """One fault, whatever there is."""
        if len(self.unknown) + len(self.unitless) + len(self.missing) == 1:
            self._tell_one(line, faults, kinds)
        elif self.unknown or self.unitless or self.missing:
            self._tell_all(line, faults)

    def _tell_one(self, line: int, faults: Faults, kinds: dict[str, Kind]) -> None:
        for name, near in self.unknown.items():
            hint = f"did you mean '{near}'?" if near else f"known are {', '.join(kinds)}"
            message, column, value, said = ("unknown column", name, name, hint) if name else _NAMELESS
            faults.add(message, column, value, said, line)
        for name, hint in self.unitless.items():
            faults.add("the column has no unit", name, None, hint, line)
        for name, head in self.missing.items():
            what = "the column of this joint is missing" if name else "nothing is measured"
            faults.add(what, name, hint=f"add {head}", line=line)

    def _tell_all(self, line: int, faults: Faults) -> None:
        parts = []
        if self.missing:
            parts.append(f"missing {listed(self.missing.values())}")
        if self.unknown:
            told = [f"'{name}'" + (f" (did you mean {near}?)" if near else "") for name, near in self.unknown.items()]
            parts.append(f"unknown {listed(told, _NAMED)}")
        if self.unitless:
            parts.append(f"no unit in {listed(self.unitless)}")
        faults.add(f"the header does not fit: {'; '.join(parts)}", hint=self._hint(), line=line)

    def _hint(self) -> str:
        pairs = {near: head for head, near in self.unknown.items() if near and near not in (*LABELS, *_INPUTS)}
        if self.unknown and self.missing:
            told = ", ".join(f'{name}: "{head}"' for name, head in pairs.items()) or _example(self)
            which = f"data: {{columns: {{{told}{'' if {*self.missing} <= {*pairs, ''} else ', …'}}}}}"
            option = (told.split(", ")[0]).replace(': "', "=").rstrip('"')
            return f'rename them, or say which is which: {which} in the problem file, or --column "{option}" …'
        if self.unitless:
            heads = ", ".join(hint.removeprefix("write ") for hint in self.unitless.values())
            units = ", ".join(f"{name}: {_unit_in(hint)}" for name, hint in list(self.unitless.items())[:2])
            return f"write {heads}, or in the problem file data: {{units: {{{units}, …}}}}"
        return "rename them or leave them out" if self.unknown else "add them"


_NAMELESS = ("a column has no name", "", None, "name it, or leave out the commas at the ends of lines")


def _example(header: Header) -> str:
    return f'{next(iter(header.missing)) or "x"}: "{next(iter(header.unknown))}"'


def _unit_in(hint: str) -> str:
    return hint.rpartition("[")[2].rstrip("]")


def read_header(
    heads: Sequence[str], robot: Robot, line: int, faults: Faults, spec: DataSpec | None = None
) -> tuple[dict[str, Column], tuple[str, ...]]:
    """The known columns by name, and the heads that are left out; what else is wrong joins ``faults``."""
    header = _read(heads, robot, line, faults, spec or DataSpec())
    there = {*header.found, *header.meant}
    _missing(header, there, robot)
    if _anothers(header, robot, line, faults):
        return header.found, ()
    header.tell(line, faults, column_kinds(robot))
    _contradictions(header, there, robot, line, faults)
    return header.found, tuple(header.left_out)


def known_columns(heads: Sequence[str], robot: Robot, line: int, faults: Faults) -> tuple[dict[str, Column], set[str]]:
    """The known columns by name, and what unknown ones were probably meant to be; these, doubled or unitless ones join
    ``faults``, and nothing that is missing does.
    """
    header = _read(heads, robot, line, faults, DataSpec())
    if _anothers(header, robot, line, faults):
        return header.found, {*robot.joint_names, *header.meant}
    header.tell(line, faults, column_kinds(robot))
    return header.found, header.meant


def _read(heads: Sequence[str], robot: Robot, line: int, faults: Faults, spec: DataSpec) -> Header:
    sized, kinds = dimensions(robot), column_kinds(robot)
    _clashes(robot, faults)
    header = Header()
    others: list[str] = []
    for index, (name, unit) in enumerate(_named(heads, spec, line, faults)):
        if name not in kinds:
            others.append(name)
        elif name in header.found:
            faults.add("two columns have this name", name, hint="keep one", line=line)
        else:
            unit = _stated_unit(name, unit, spec, line, faults)
            factor, offset = _scale(name, unit, sized.get(name, ""), line, header, faults)
            header.found[name] = Column(name, index, kinds[name], factor, offset, unit)
    free = [name for name in kinds if name not in header.found]
    for name in others:
        if spec.columns and not get_close_matches(name.lower(), free, 1, _MISTYPED):
            header.left_out += [name] if name else []
        else:
            header.unknown[name] = _alike(name, free, robot) or nearest(name, free)
    return header


def _named(heads: Sequence[str], spec: DataSpec, line: int, faults: Faults) -> list[tuple[str, str]]:
    """Name and unit of every column, called as the problem file says."""
    found = [_parts(head) for head in heads]
    for name, wanted in spec.columns.items():
        at = _places(heads, wanted)
        if len(at) == 1:
            own = [k for k, (other, _) in enumerate(found) if other == name and k != at[0]]
            for k in own:  # another column of that name is not meant
                found[k] = (f"{name} of the file", found[k][1])
            found[at[0]] = (name, _bracketed(heads[at[0]]))
        elif at:
            which = listed(str(k + 1) for k in at)
            hint = f"name it by its number: data: {{columns: {{{name}: {at[0] + 1}}}}}"
            faults.add(f"the columns {which} are called '{wanted}'", name, wanted, hint, line)
        elif all(other != name for other, _ in found):
            faults.add(f"there is no column {wanted!r}", name, wanted, _near_head(heads, wanted), line)
    return found


def _places(heads: Sequence[str], wanted: str | int) -> list[int]:
    """The columns that a problem file means: by number, by the whole head, or by the head without its unit."""
    if isinstance(wanted, int):
        return [wanted - 1] if wanted <= len(heads) else []
    plain = wanted.strip()
    whole = [k for k, head in enumerate(heads) if head.strip() == plain]
    return whole or [k for k, head in enumerate(heads) if plain in (_parts(head)[0], _round(head)[0])]


def _near_head(heads: Sequence[str], wanted: str | int) -> str:
    if isinstance(wanted, int):
        return f"the file has {len(heads)} columns"
    near = nearest(wanted, heads)
    return f"did you mean '{near.strip()}'?" if near else f"the file has {listed((h.strip() for h in heads), _NAMED)}"


def _parts(head: str) -> tuple[str, str]:
    match = HEAD.match(head)
    return (match["name"], (match["unit"] or "").strip()) if match else (head.strip(), "")


def _round(head: str) -> tuple[str, str]:
    match = ROUND.match(head)
    return (match["name"], match["unit"].strip()) if match else (head.strip(), "")


def _bracketed(head: str) -> str:
    """The unit of a foreign head, in brackets of either kind."""
    unit = _parts(head)[1] or _round(head)[1]
    return _SPELT_OUT.get(unit.lower().removesuffix("s"), unit)


def _stated_unit(name: str, unit: str, spec: DataSpec, line: int, faults: Faults) -> str:
    stated = spec.units.get(name, "")
    if stated and unit and stated != unit:
        message = f"the head says '{unit}', the problem file '{stated}'"
        faults.add(message, name, unit, "keep the right one: data: {units: …} is for heads without a unit", line)
    return unit or stated


def _scale(name: str, unit: str, dimension: str, line: int, header: Header, faults: Faults) -> tuple[float, float]:
    """Factor and offset of a column; a wrong or missing unit is a fault, and the cells are still read."""
    if not dimension:
        if unit not in ("", "-", "1"):
            faults.add(f"a column without dimension has the unit '{unit}'", name, unit, f"write {name}", line)
        return 1.0, 0.0
    hint = f"write {name} [{_UNITS[dimension]}]"
    if not unit:
        header.unitless[name] = hint
    elif dimension == "temperature":
        if unit in _CELSIUS:
            return 1.0, _CELSIUS[unit]
        faults.add(f"'{unit}' is not a unit of temperature", name, unit, hint, line)
    elif unit == DIMENSIONS[dimension][0]:  # needs no table of units
        return 1.0, 0.0
    else:
        try:
            return parse_quantity(f"1 {unit}", dimension), 0.0
        except BadValueError as error:
            faults.add(error.message, name, unit, hint, line)
    return 1.0, 0.0


def _clashes(robot: Robot, faults: Faults) -> None:
    taken = {*AXES, *QUATERNION, *LABELS, *_INPUTS, *(f"{name}.approach" for name in robot.joint_names)}
    for name in robot.joint_names:
        if name in taken:
            faults.add("a joint has the name of a column of measurements", name, hint="rename the joint in the problem")


def _alike(head: str, free: Sequence[str], robot: Robot) -> str:
    """What a foreign head probably stands for: an axis by its letter, a joint by its number; empty where nothing."""
    words = [word.lower() for word in re.findall(r"[A-Za-z]+|\d+", head)]
    if axes := [axis for axis in AXES if axis in words]:
        return axes[0] if len(axes) == 1 and axes[0] in free else ""
    numbers = [int(word) for word in words if word.isdigit()]
    if len(numbers) == 1 and 1 <= numbers[0] <= robot.n and {"j", "q", "a", "joint", "axis", "achse"} & {*words}:
        name = robot.joint_names[numbers[0] - 1]
        return name if name in free else ""
    return ""


def _anothers(header: Header, robot: Robot, line: int, faults: Faults) -> bool:
    """Complains where no column is a joint of this robot, and others may be those of another one."""
    joints, unknown = set(robot.joint_names), list(header.unknown)
    alike = {name.lower() for name in joints} & {name.lower() for name in unknown}
    guessed = joints & header.meant
    others = len(unknown) >= len(joints) or (len(unknown) > 1 and not guessed)
    if not others or len(joints) < 2 or joints & set(header.found) or alike or len(guessed) == len(joints):
        return False
    ours, theirs = ", ".join(robot.joint_names), listed(unknown, _NAMED)
    message = f"no column is a joint of the problem's robot ({ours}), but there are {theirs}"
    hint = "is it another robot's file? name its problem file, or say which columns are this robot's joints: "
    hint += f'data: {{columns: {{{robot.joint_names[0]}: "{unknown[0]}", …}}}}'
    faults.add(message, hint=hint, line=line)
    return True


def _missing(header: Header, there: set[str], robot: Robot) -> None:
    """Joints without a column, and a file in which nothing was measured."""
    guessed = {name for head, name in header.unknown.items() if name and not nearest(head, [name])}
    there = there - guessed
    several = len(header.unknown) > 1
    for joint in robot.joints:
        if joint.name not in there or (joint.name in guessed | (header.meant if several else set())):
            header.missing[joint.name] = f"{joint.name} [{'deg' if joint.type == 'revolute' else 'mm'}]"
    measured = [axis for axis in AXES if axis in there]
    if not measured and "point" not in there:
        header.missing[""] = "x [mm], y [mm], z [mm], or point for touched points"
    header.missing |= {axis: f"{axis} [mm]" for axis in AXES if measured and several and axis in header.meant}


def _contradictions(header: Header, there: set[str], robot: Robot, line: int, faults: Faults) -> None:
    measured = [axis for axis in AXES if axis in there]
    if "point" in header.found and measured:
        message = f"both point and {', '.join(measured)} are given"
        hint = "point takes the place of x, y, z where no instrument measures; leave out one of the two"
        faults.add(message, "point", hint=hint, line=line)
    incomplete_orientation(there, robot, line, faults)
