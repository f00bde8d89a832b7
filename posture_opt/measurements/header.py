"""The header of a table of measurements: which column is what, in which unit, and what is missing or unknown."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches

from posture_opt.errors import BadValueError, Issue, listed, nearest, one_of
from posture_opt.measurements.columns import AXES, LABELS, CellKind, Column
from posture_opt.measurements.data_section import NOTHING_STATED, DataSpec
from posture_opt.measurements.kinds import KINDS, Position
from posture_opt.measurements.kinds.pose import ORIENTATION_GROUPS
from posture_opt.measurements.layout import ROUND_HEADER, name_and_unit
from posture_opt.measurements.orientation_columns import (
    incomplete_orientation,
    orientation_names,
    turned_joints_of,
)
from posture_opt.measurements.table import Faults
from posture_opt.robot.robot import Robot
from posture_opt.units import DIMENSIONS, parse_quantity

# Columns of inputs of effects, with their dimension
_INPUT_DIMENSIONS = {"payload": "mass", "temperature": "temperature", "time": "time"}
# Dimension -> the unit that messages suggest
_USUAL_UNITS = {"angle": "deg", "length": "mm", "mass": "kg", "temperature": "degC", "time": "s", "pixel": "px"}
# Units that instruments spell out, without a plural s
_UNIT_ABBREVIATIONS = {
    "second": "s",
    "meter": "m",
    "millimeter": "mm",
    "degree": "deg",
    "radian": "rad",
    "kilogram": "kg",
}
# Unit of temperature -> factor and offset to °C
_CELSIUS = {"degC": (1.0, 0.0), "°C": (1.0, 0.0), "K": (1.0, -273.15), "degF": (1 / 1.8, -32 / 1.8)}
_RATES = {"velocity", "effort", "acceleration", "current", "torque"}  # Words of headers of logs that hold no position
_SEVERAL_MARKERS = re.compile(r"[xyz][ _.]?(\d+)\b", re.IGNORECASE)  # A coordinate with the number of its marker
_MAX_LISTED_COLUMNS = 20  # Columns of a foreign file that a message lists


def column_dimensions(robot: Robot, spec: DataSpec) -> dict[str, str]:
    """Every column that has a unit, with its dimension: joints, coordinates, orientations, inputs of effects."""
    joints = {joint.name: "angle" if joint.type == "revolute" else "length" for joint in robot.joints}
    return {
        **Position.columns_in(spec),
        **dict.fromkeys(orientation_names(robot, angles=True), "angle"),
        **{name: dimension for kind in KINDS for name, dimension in kind.columns_in(spec).items()},
        **_INPUT_DIMENSIONS,
        **joints,
    }


def column_kinds(robot: Robot, spec: DataSpec = NOTHING_STATED) -> dict[str, CellKind]:
    """Every column that a file of this robot may have, with how its cells are read."""
    numbers = (*column_dimensions(robot, spec), *orientation_names(robot, angles=False))
    sides = (f"{name}.approach" for name in robot.joint_names)
    return {**dict.fromkeys(numbers, "number"), **dict.fromkeys(LABELS, "label"), **dict.fromkeys(sides, "side")}


def data_issues(spec: DataSpec, robot: Robot) -> list[Issue]:
    """Columns that the section ``data`` speaks of and that no file of this robot has; keys relative to the section."""
    known = column_kinds(robot, spec)
    columns, joints = ("no file of this robot has such a column", known), ("no such joint", robot.joint_names)
    keys = {"columns": columns, "units": columns, "joint_zeros": joints, "joint_signs": joints}
    issues = [
        Issue(message, (key, name), name, one_of(name, names, "known"))
        for key, (message, names) in keys.items()
        for name in getattr(spec, key)
        if name not in names
    ]
    for joint in robot.joints:
        turns = joint.type == "revolute"
        if joint.name in spec.joint_zeros and not spec.joint_zeros[joint.name].suits("angle" if turns else "length"):
            hint = f"write {'180 deg' if turns else '10 mm'}, say"
            issues.append(Issue("the zero has the wrong unit", ("joint_zeros", joint.name), hint=hint))
    return issues


@dataclass
class Header:
    """What was found in the column headers: known columns, and what is wrong with the others."""

    found: dict[str, Column] = field(default_factory=dict)  # known name -> its column
    # header -> the known name that was probably meant; empty where none is like it
    unknown: dict[str, str] = field(default_factory=dict)
    unitless: dict[str, str] = field(default_factory=dict)  # known name -> usual unit
    # known name -> header to add; under an empty name that nothing is measured
    missing: dict[str, str] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)  # headers that are not used, as the problem file says which are

    @property
    def probable_names(self) -> set[str]:
        """Known names that unknown headers were probably meant to be."""
        return {name for name in self.unknown.values() if name}

    def report_faults(self, line: int, faults: Faults, kinds: dict[str, CellKind]) -> None:
        """One fault for the whole header, whatever is wrong with it: one thing in detail, several in one sentence."""
        if len(self.unknown) + len(self.unitless) + len(self.missing) != 1:
            unknown = [f"'{name}'" + f" (did you mean {near}?)" * bool(near) for name, near in self.unknown.items()]
            parts = [f"missing {listed(self.missing.values())}"] if self.missing else []
            parts += [f"unknown {listed(unknown, _MAX_LISTED_COLUMNS)}"] if unknown else []
            parts += [f"no unit in {listed(self.unitless)}"] if self.unitless else []
            if parts:
                faults.add(f"the header does not fit: {'; '.join(parts)}", hint=self._mapping_hint(), line=line)
            return
        for name, near in self.unknown.items():
            hint = f"did you mean '{near}'?" if near else f"known are {', '.join(kinds)}"
            if name:
                faults.add("unknown column", name, name, hint, line)
            else:
                faults.add(
                    "a column has no name", hint="name it, or leave out the commas at the ends of lines", line=line
                )
        for name, unit in self.unitless.items():
            faults.add("the column has no unit", name, None, f"write {name} [{unit}]", line)
        for name, title in self.missing.items():
            what = "the column of this joint is missing" if name else "nothing is measured"
            faults.add(what, name, hint=f"add {title}", line=line)

    def _mapping_hint(self) -> str:
        labels = (*LABELS, *_INPUT_DIMENSIONS)
        pairs = {near: title for title, near in self.unknown.items() if near and near not in labels}
        numbers = [found[1] for title in self.unknown if (found := _SEVERAL_MARKERS.match(title))]
        if len({*numbers}) > 1 and len(numbers) > 3:
            return "write one row a marker: x, y, z, and the marker's name in the column target"
        if self.unknown and self.missing:
            pairs = pairs or {next(iter(self.missing)) or "x": next(iter(self.unknown))}
            mapping = [f'{name}: "{title}"' for name, title in pairs.items()]
            more = "" if {*self.missing} <= {*pairs, ""} else ", …"
            which = f"data: {{columns: {{{', '.join(mapping)}{more}}}}}"
            option = mapping[0].replace(': "', "=").rstrip('"')
            return f'rename them, or say which is which: {which} in the problem file, or --column "{option}" …'
        if self.unitless:
            titles = ", ".join(f"{name} [{unit}]" for name, unit in self.unitless.items())
            units = ", ".join(f"{name}: {unit}" for name, unit in list(self.unitless.items())[:2])
            return f"write {titles}, or in the problem file data: {{units: {{{units}, …}}}}"
        return "rename them or leave them out" if self.unknown else "add them"


def read_header(
    titles: Sequence[str], robot: Robot, line: int, faults: Faults, spec: DataSpec = NOTHING_STATED
) -> tuple[dict[str, Column], tuple[str, ...]]:
    """The known columns by name, and the column headers that are left out; what else is wrong joins ``faults``."""
    header = _read_columns(titles, robot, line, faults, spec)
    there = {*header.found, *header.probable_names}
    _note_missing(header, there, robot, spec)
    if _is_of_another_robot(header, robot, line, faults):
        return header.found, ()
    header.report_faults(line, faults, column_kinds(robot, spec))
    _contradiction_faults(header, there, robot, line, faults, spec)
    return header.found, tuple(header.left_out)


def known_columns(titles: Sequence[str], robot: Robot, line: int, faults: Faults) -> tuple[dict[str, Column], set[str]]:
    """The known columns by name, and what unknown ones were probably meant to be."""
    # These, doubled or unitless ones join ``faults``, and nothing that is missing does
    header = _read_columns(titles, robot, line, faults, NOTHING_STATED)
    if _is_of_another_robot(header, robot, line, faults):
        return header.found, {*robot.joint_names, *header.probable_names}
    header.report_faults(line, faults, column_kinds(robot))
    return header.found, header.probable_names


def _read_columns(titles: Sequence[str], robot: Robot, line: int, faults: Faults, spec: DataSpec) -> Header:
    sized, kinds = column_dimensions(robot, spec), column_kinds(robot, spec)
    taken = {*AXES, *ORIENTATION_GROUPS["quaternion"], *LABELS, *_INPUT_DIMENSIONS}
    for name in robot.joint_names:
        if name in taken | {f"{other}.approach" for other in robot.joint_names}:
            faults.add("a joint has the name of a column of measurements", name, hint="rename the joint in the problem")
    header = Header()
    others: list[str] = []
    for index, (name, unit) in enumerate(_counted(_named_columns(titles, spec, line, faults), robot)):
        if name not in kinds:
            others.append(name)
        elif name in _INPUT_DIMENSIONS and spec.columns and not (unit or {name} & {*spec.columns, *spec.units}):
            header.left_out.append(name)  # as of a log: nobody said what it is
        elif name in header.found:
            faults.add("two columns have this name", name, hint="keep one", line=line)
        else:
            stated = spec.units.get(name, "")
            if stated and unit and stated != unit:
                hint = "keep the right one: data: {units: …} is for column headers without a unit"
                message = f"the column header says '{unit}', the problem file '{stated}'"
                faults.add(message, name, unit, hint, line)
            unit = unit or stated
            factor, offset = _unit_scale(name, unit, sized.get(name, ""), line, header, faults)
            header.found[name] = Column(name, index, kinds[name], factor, offset, unit)
    free = [name for name in kinds if name not in header.found]
    text = robot.description.data if robot.description else b""
    outside = re.findall(rb"<joint\s[^>]*?\bname\s*=\s*[\"']([^\"']+)[\"']", text)
    for name in others:
        if name.encode() in outside and name not in robot.joint_names:
            hint = "leave the column out if it stood still, or state another base_link in the section robot"
            faults.add("a joint of the URDF that is not between base_link and tip_link", name, hint=hint, line=line)
        elif spec.columns and (
            name.strip("_%# ") in _INPUT_DIMENSIONS or not get_close_matches(name.lower(), free, 1, 0.8)
        ):
            header.left_out += [name] if name else []
        else:
            header.unknown[name] = _likely_column(name, free, robot) or nearest(name, free)
    return header


def _counted(found: list[tuple[str, str]], robot: Robot) -> list[tuple[str, str]]:
    names = [name.removesuffix(".approach") for name, _ in found]
    called = {f"q{k}": name for k, name in enumerate(robot.joint_names, 1)}
    if not {*called} <= {*names} or {*names} & {*robot.joint_names}:
        return found
    both = zip(names, found, strict=True)
    return [(called.get(plain, plain) + name.removeprefix(plain), unit) for plain, (name, unit) in both]


def _named_columns(titles: Sequence[str], spec: DataSpec, line: int, faults: Faults) -> list[tuple[str, str]]:
    found = [*map(name_and_unit, titles)]
    for name, wanted in spec.columns.items():
        at = _matching_columns(titles, wanted)
        if len(at) == 1:
            # Another column of that name is not meant.
            found = [(f"{name} of the file", unit) if other == name else (other, unit) for other, unit in found]
            unit = name_and_unit(titles[at[0]])[1] or _split_round(titles[at[0]])[1]
            found[at[0]] = (name, _UNIT_ABBREVIATIONS.get(unit.lower().removesuffix("s"), unit))
        elif at:
            which = listed(str(k + 1) for k in at)
            hint = f"name it by its number: data: {{columns: {{{name}: {at[0] + 1}}}}}"
            faults.add(f"the columns {which} are called '{wanted}'", name, wanted, hint, line)
        elif all(other != name for other, _ in found):
            hint = f"the file has {listed((h.strip() for h in titles), _MAX_LISTED_COLUMNS)}"
            if isinstance(wanted, int):
                hint = f"the file has {len(titles)} columns"
            elif near := nearest(wanted, titles):
                hint = f"did you mean '{near.strip()}'?"
            faults.add(f"there is no column {wanted!r}", name, wanted, hint, line)
    return found


def _matching_columns(titles: Sequence[str], wanted: str | int) -> list[int]:
    if isinstance(wanted, int):
        return [wanted - 1] if wanted <= len(titles) else []
    plain = wanted.strip()
    whole = [k for k, title in enumerate(titles) if title.strip() == plain]
    names = [(name_and_unit(title)[0], _split_round(title)[0]) for title in titles]
    return whole or [k for k, own in enumerate(names) if plain in own]


def _split_round(title: str) -> tuple[str, str]:
    match = ROUND_HEADER.match(title)
    return (match["name"], match["unit"].strip()) if match else (title.strip(), "")


def _unit_scale(name: str, unit: str, dimension: str, line: int, header: Header, faults: Faults) -> tuple[float, float]:
    if not dimension:
        if unit not in ("", "-", "1"):
            faults.add(f"a column without dimension has the unit '{unit}'", name, unit, f"write {name}", line)
        return 1.0, 0.0
    hint = f"write {name} [{_USUAL_UNITS[dimension]}]"
    if not unit:
        header.unitless[name] = _USUAL_UNITS[dimension]
    elif dimension == "temperature":
        if unit in _CELSIUS:
            return _CELSIUS[unit]
        faults.add(f"'{unit}' is not a unit of temperature", name, unit, hint, line)
    elif unit == DIMENSIONS[dimension][0]:  # needs no table of units
        return 1.0, 0.0
    else:
        try:
            return parse_quantity(f"1 {unit}", dimension), 0.0
        except BadValueError as error:
            faults.add(error.message, name, unit, hint, line)
    return 1.0, 0.0


def _likely_column(title: str, free: Sequence[str], robot: Robot) -> str:
    parts = {*re.split(r"[/.:\s]+", title)}
    if len(own := [name for name in robot.joint_names if parts & {name, f"{name}_joint", f"joint_{name}"}]) == 1:
        return own[0] if own[0] in free and not parts & _RATES else ""
    words = [word.lower() for word in re.findall(r"[A-Za-z]+|\d+", title)]
    if axes := [axis for axis in AXES if axis in words]:
        return axes[0] if len(axes) == 1 and axes[0] in free else ""
    numbers = [int(word) for word in words if word.isdigit()]
    if len(numbers) == 1 and 1 <= numbers[0] <= robot.n and {"j", "q", "a", "joint", "axis", "achse"} & {*words}:
        name = robot.joint_names[numbers[0] - 1]
        return name if name in free else ""
    return ""


def _is_of_another_robot(header: Header, robot: Robot, line: int, faults: Faults) -> bool:
    joints, unknown = set(robot.joint_names), [title for title, near in header.unknown.items() if near not in AXES]
    alike = {name.lower() for name in joints} & {name.lower() for name in unknown}
    guessed = joints & header.probable_names
    others = len(unknown) >= len(joints) or (len(unknown) > 1 and not guessed)
    if not others or len(joints) < 2 or joints & set(header.found) or alike or len(guessed) == len(joints):
        return False
    ours, theirs = ", ".join(robot.joint_names), listed(unknown, _MAX_LISTED_COLUMNS)
    message = f"no column is a joint of the problem's robot ({ours}), but there are {theirs}"
    hint = f'say which columns are joints: data: {{columns: {{{robot.joint_names[0]}: "{unknown[0]}", …}}}}; of poses '
    hint += "of the flange write robot: {kind: flange} and columns flange_x, flange_rx …"
    faults.add(message, hint=hint, line=line)
    return True


def _note_missing(header: Header, there: set[str], robot: Robot, spec: DataSpec) -> None:
    guessed = {name for title, name in header.unknown.items() if name and not nearest(title, [name])}
    there = there - guessed
    several = len(header.unknown) > 1
    turned = turned_joints_of(robot, there)
    for joint in robot.joints:
        if joint.name in turned:
            continue
        if joint.name not in there or (joint.name in guessed | (header.probable_names if several else set())):
            header.missing[joint.name] = f"{joint.name} [{'deg' if joint.type == 'revolute' else 'mm'}]"
    measured = [axis for axis in AXES if axis in there]
    meant = [axis for axis in AXES if axis in guessed]
    nothing = not measured and not any(kind.required(spec, ()) & there for kind in KINDS)
    if nothing and len(meant) > 1:
        header.missing |= {axis: f"{axis} [mm]" for axis in meant}
    elif nothing:
        *others, last = (kind.example for kind in KINDS)
        header.missing[""] = f"{', '.join(others)}, or {last}"
    header.missing |= {axis: f"{axis} [mm]" for axis in AXES if measured and several and axis in header.probable_names}


def _contradiction_faults(
    header: Header, there: set[str], robot: Robot, line: int, faults: Faults, spec: DataSpec
) -> None:
    measured = [axis for axis in AXES if axis in there]
    kinds = [(kind, sorted(kind.required(spec, ()) & {*header.found})) for kind in KINDS]
    others = [(kind, columns) for kind, columns in kinds if columns]
    incomplete_orientation(there, robot, line, faults)
    if robot.pose_prefix:
        incomplete_orientation(there, robot, line, faults, robot.pose_prefix)
    if "instrument" in there:
        return
    if (others and measured) or len(others) > 1:
        both = [", ".join(columns) for _, columns in others] + [", ".join(measured)] * bool(measured)
        message = f"both {' and '.join(both)} are given"
        hint = f"{both[0]} takes the place of x, y, z where no instrument measures; leave out one of the two"
        faults.add(message, others[0][1][0], hint=hint, line=line)
    for kind, columns in others if len(others) == 1 else ():
        for name in sorted(kind.required(spec, ()) - {*columns, *there}):
            faults.add(f"{columns[0]} is given without {name}", name, hint=f"add {kind.example}", line=line)
