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
from posture_opt.problem.problem import Problem
from posture_opt.problem.yaml_source import Plain, Section
from posture_opt.robot.preset import preset_text
from posture_opt.robot.robot import Robot
from posture_opt.units import number

_COUNTED_COLUMN = re.compile(r"^\s*(?P<stem>[A-Za-z]+[ _-]?)(?P<number>\d+)\s*\[")


def problem_of_measured_robot(
    section: Mapping[str, Plain],
    data: TableLike,
    uncertainty: Mapping[str, Plain] | None = None,
    columns: Mapping[str, str | int] | None = None,
) -> Problem:
    """A problem to calibrate a robot with."""
    # Base and tool free, the instrument's σ from repeats where there are enough
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
    origin = f"is the scatter of repeats ({freedom} degrees of freedom), the arm's included"
    scatter = f"σ of the instrument, {number(sigma * 1e3, 2)} mm, {origin}" if freedom >= MIN_FREEDOM else ""
    return _introduced(problem, scatter, measured.touches)


def _introduced(problem: Problem, scatter: str, touches: bool) -> Problem:
    """The problem with what its file says first: which frames are free, and where the instrument's σ is from."""
    frames = [name for name, free in (("base", problem.robot.base_free), ("tool", problem.robot.tool_free)) if free]
    note = "no problem file is given; base and tool are those of the command line"
    if frames:
        are = "are" if len(frames) > 1 else "is"
        note = f"no problem file is given: {' and '.join(frames)} {are} free, to be found from the data"
    few = "Too few postures are repeated to estimate the instrument's σ. Where it is known, state under uncertainty"
    instrument = few, "  measurement: {position: 0.02 mm}"
    if touches:
        size = "Points are touched: a known distance gives the size of the arm,"
        instrument = size, "  data: {distances: [[a, b, 50 mm]]}"
    elif scatter:
        instrument = f"The {scatter}.", "State the instrument's own where it is known."
    header = (
        "A problem file of posture_opt, made for measurements of a robot. Edit it, and name it with --problem.",
        "A base or tool that is free is found from the data. Where one is known, write {xyz: [..], rpy: [..]}.",
        *instrument,
        "With a task, its posture is planned before and after calibration, in the frame of the measurements:",
        "  task: {kind: insert, direction: [0, 0, -1], position: [0.5 m, 0.2 m, 0.2 m]}",
    )
    notes = (*problem.notes, note, *([f"the {scatter}"] if scatter else []))
    return replace(problem, notes=notes, header=header)


def _named_as_counted(section: Section, robot: Robot, headers: Sequence[str]) -> Section:
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
