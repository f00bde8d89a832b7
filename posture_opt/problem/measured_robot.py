"""A problem for measurements that come without a problem file: the nominal robot with free frames."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import yaml

from posture_opt.measurements.reading import read_measurements
from posture_opt.measurements.repeats import MIN_FREEDOM, repeated_readings
from posture_opt.measurements.table import TableLike, open_table
from posture_opt.problem.load import problem_from_dict
from posture_opt.problem.plain_data import Plain, Section
from posture_opt.problem.problem import Problem
from posture_opt.robot.preset import preset_text
from posture_opt.robot.robot import Robot
from posture_opt.units import number

_COUNTED_COLUMN = re.compile(r"^\s*(?P<stem>[A-Za-z]+[ _-]?)(?P<number>\d+)\s*\[")
_EXAMPLE_TASK = "task: {kind: insert, direction: [0, 0, -1], position: [0.5 m, 0.2 m, 0.2 m]}"


def problem_of_measured_robot(
    section: Mapping[str, Plain],
    data: TableLike,
    uncertainty: Mapping[str, Plain] | None = None,
    columns: Mapping[str, str | int] | None = None,
) -> Problem:
    """A problem to calibrate a robot with: base and tool free, the instrument's σ from repeats where there are enough.

    Columns that count the joints of a preset, ``q1 … q6``, name them: the preset's table is then written out under
    these names. The preset's repeatability is that of its data sheet.

    Args:
        section: the ``robot`` section of a problem file, ``{kind: preset, name: ur10}``.
        data: the measurements, a file or a table.
        uncertainty: the section of that name, where something is stated.
        columns: known column -> header or number in the file, as in the section ``data``.

    Raises:
        InputError: the robot or the file cannot be used, or its columns are none of this robot's.
    """
    robot = dict(section)
    plain = problem_from_dict({"robot": robot}).robot
    if robot["kind"] == "preset" and not {*(columns or ())} & {*plain.joint_names}:
        robot = _named_as_counted(robot, plain, open_table(data).titles)
    document = {"name": plain.name or "Measured robot", "robot": {"base": "free", "tool": "free", **robot}}
    if plain.mounting_below and robot["kind"] != "preset":
        document["cell"] = {"mounting": {"below": f"{plain.mounting_below * 1e3:g} mm"}}
    document |= {"data": {"columns": dict(columns)}} if columns else {}
    free = problem_from_dict(document)
    stated = dict(uncertainty or {})
    if plain.repeatability is not None and not stated:
        stated["repeatability"] = f"{plain.repeatability.value * 1e3:g} mm"
    measured = read_measurements(data, free)
    sigma, freedom = repeated_readings(measured, free.robot)
    if freedom >= MIN_FREEDOM:
        stated["measurement"] = {"position": f"{number(sigma * 1e3, 2)} mm", "degrees_of_freedom": freedom}
    problem = problem_from_dict({**document, **({"uncertainty": stated} if stated else {})})
    repeats = _from_repeats(sigma, freedom) if freedom >= MIN_FREEDOM else ""
    notes = (*problem.notes, _free(problem.robot), *([f"the {repeats}"] if repeats else []))
    return replace(problem, notes=notes, header=_header(_instrument(repeats, measured.touches)))


def _free(robot: Robot) -> str:
    """Which frames are free, of a robot that comes without a problem file."""
    frames = [name for name, free in (("base", robot.base_free), ("tool", robot.tool_free)) if free]
    if not frames:
        return "no problem file is given; base and tool are those of the command line"
    are = "are" if len(frames) > 1 else "is"
    return f"no problem file is given: {' and '.join(frames)} {are} free, to be found from the data"


def _from_repeats(sigma: float, freedom: int) -> str:
    """Where the σ of the instrument comes from: scatter of repeats, so that it contains the scatter of the arm."""
    size = f"{number(sigma * 1e3, 2)} mm"
    return f"σ of the instrument, {size}, is the scatter of repeats ({freedom} degrees of freedom), the arm's included"


def _instrument(repeats: str, touches: bool) -> tuple[str, str]:
    """What is known of the instrument, and what could be stated: two lines of comment for the file."""
    if touches:
        return "Points are touched: a known distance gives the size of the arm,", "  data: {distances: [[a, b, 50 mm]]}"
    if repeats:
        return f"The {repeats}.", "State the instrument's own where it is known."
    return "Too few postures are repeated to estimate the instrument's σ. Where it is known, state under uncertainty", (
        "  measurement: {position: 0.02 mm}"
    )


def _header(instrument: tuple[str, str]) -> tuple[str, ...]:
    """What the file says of itself in its first lines."""
    return (
        "A problem file of posture_opt, made for measurements of a robot. Edit it, and name it with --problem.",
        "A base or tool that is free is found from the data. Where one is known, write {xyz: [..], rpy: [..]}.",
        *instrument,
        "With a task, its posture is planned before and after calibration, in the frame of the measurements:",
        f"  {_EXAMPLE_TASK}",
    )


def _named_as_counted(section: Section, robot: Robot, headers: Sequence[str]) -> Section:
    """The preset with its joints called as the columns count them; as it is where they do not.

    The columns have to count all joints in order, from 0 or from 1, with one stem: ``q1``, ``axis 1``, ``J_1``.
    """
    counted = [found for found in map(_COUNTED_COLUMN.match, headers) if found]
    numbers = [int(found["number"]) for found in counted]
    in_order = numbers in (list(range(robot.n)), list(range(1, robot.n + 1)))
    names = [found["stem"] + found["number"] for found in counted]
    if not in_order or len({found["stem"] for found in counted}) > 1 or set(names) & set(robot.joint_names):
        return section
    table = yaml.safe_load(preset_text(section["name"]))["robot"]
    joints = [{**joint, "name": name} for joint, name in zip(table["joints"], names, strict=True)]
    called = dict(zip(robot.joint_names, names, strict=True))
    shape = [{**capsule, "joint": called.get(capsule["joint"], capsule["joint"])} for capsule in table.get("shape", ())]
    velocity = {called.get(joint, joint): speed for joint, speed in table.get("velocity", {}).items()}
    stated = {key: value for key, value in section.items() if key not in ("kind", "name")}
    return {**table, **stated, "joints": joints, "shape": shape, **({"velocity": velocity} if velocity else {})}
