"""From the words of a command line to a ``Problem`` and a posture."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import click

from posture_opt.cli.sigma import entries, exact_note, joint_sigmas
from posture_opt.errors import BadValueError, InputError, Issue, KeyPath, did_you_mean, nearest
from posture_opt.files import nearest_file
from posture_opt.problem.load import builtin_names, builtin_problem, load_problem, problem_from_dict
from posture_opt.problem.problem import Problem
from posture_opt.robot import preset_names
from posture_opt.robot.robot import Robot
from posture_opt.units import parse_quantity

T = TypeVar("T")

_OPTION_OF: dict[KeyPath, str] = {
    # place in a problem file -> the option that fills it
    ("task", "kind"): "--task",
    ("task", "position"): "--position",
    ("task", "direction"): "--direction",
    ("robot", "name"): "--robot",
    ("robot", "file"): "--robot",
    ("robot", "base_link"): "--base-link",
    ("robot", "tip_link"): "--tip-link",
    ("uncertainty", "sigma"): "--sigma",
    ("uncertainty",): "--sigma",
}


def requested_problem(
    problem: str | None,
    robot: str | None,
    base_link: str | None = None,
    tip_link: str | None = None,
    sigma: str | None = None,
    task: str | None = None,
    position: str | None = None,
    direction: str | None = None,
    link_height: str | None = None,
) -> Problem:
    """The problem that the options describe.

    Raises:
        InputError: what the options or the file say does not fit.
        UsageError: options that exclude each other, or none that names a robot.
    """
    if problem and robot:
        raise click.UsageError("--problem and --robot both name a robot: keep one of them.")
    if robot is None and (sigma or base_link or tip_link):
        raise click.UsageError("--sigma, --base-link and --tip-link go with --robot; a problem file has them inside.")
    goal: dict[str, Any] = {}
    if position:
        goal["position"] = entries(position)
    if direction:
        goal["direction"] = entries(direction)
    if link_height:
        goal["subject_to"] = [_link_height(link_height)]
    if robot:
        return _as_options(lambda: _problem_of_robot(str(robot), base_link, tip_link, sigma, task, goal))
    if problem:
        chosen = _load(problem)
    elif task:
        chosen = _as_options(lambda: builtin_problem(task))
    else:
        raise click.UsageError("Name a --problem or a --robot.")
    if link_height:
        former = (chosen.document.get("task") or {}).get("subject_to") or []
        goal["subject_to"] = [*(term for term in former if term["kind"] != "link_height"), *goal["subject_to"]]
    return _as_options(lambda: chosen.with_task(task, **goal)) if task or goal else chosen


def _load(name: str) -> Problem:
    """A file, or where there is none of that name, a built-in problem."""
    near = "" if name in builtin_names() else nearest(name, builtin_names())
    if near and not Path(name).exists() and not nearest_file(Path(name)):
        raise InputError(Issue(f"no such file: {name}", mend=f"did you mean the built-in '{near}'?"))
    return load_problem(name)


def _problem_of_robot(
    robot: str, base_link: str | None, tip_link: str | None, sigma: str | None, task: str | None, goal: dict[str, Any]
) -> Problem:
    section = _robot_section(robot, base_link, tip_link)
    data: dict[str, Any] = {"name": f"{task or 'robot'}: {Path(robot).stem}", "robot": section}
    if goal and not task:
        raise click.UsageError("--position, --direction and --link-height belong to a task: name it with --task.")
    if task:
        data["task"] = {"kind": task, **goal}
    if not sigma:
        return problem_from_dict(data)
    joints = problem_from_dict({"robot": section}).robot.joints
    data["uncertainty"] = {"sigma": joint_sigmas(sigma, joints)}
    problem = problem_from_dict(data)
    return replace(problem, notes=(*problem.notes, *exact_note(joints, data["uncertainty"]["sigma"])))


def _robot_section(robot: str, base_link: str | None, tip_link: str | None) -> dict[str, Any]:
    is_file = robot.lower().endswith((".urdf", ".xml")) or "/" in robot or Path(robot).is_file()
    if not is_file and (base_link or tip_link):
        raise click.UsageError("--base-link and --tip-link choose a chain in a URDF file, and --robot names a preset.")
    if is_file:
        links = {"base_link": base_link, "tip_link": tip_link}
        return {"kind": "urdf", "file": robot, **{key: link for key, link in links.items() if link}}
    if robot not in preset_names():
        mend = f"{did_you_mean(robot, preset_names())} Or name a URDF file"
        raise InputError(Issue(f"there is no preset '{robot}'", ("--robot",), robot, mend))
    return {"kind": "preset", "name": robot}


def height_of(text: str) -> float:
    """The height [m] that ``--link-height`` states.

    Raises:
        InputError: it is no length.
    """
    try:
        return parse_quantity(text, "length")
    except BadValueError as error:
        raise InputError(error.issue(("--link-height",), text)) from None


def _link_height(text: str) -> dict[str, str]:
    """The bound that keeps all links at least this high."""
    height_of(text)
    return {"kind": "link_height", "at_least": text}


def _as_options(build: Callable[[], T]) -> T:
    """What ``build`` makes; its complaints name options in place of keys of a file."""
    try:
        return build()
    except InputError as error:
        raise InputError([_named_as_option(issue) for issue in error.issues]) from None


@contextmanager
def placed(problem: Problem) -> Iterator[None]:
    """What is wrong with the input and shows in computing only, with its file and line or its option."""
    try:
        yield
    except InputError as error:
        issues = [_named_as_option(problem.placed(issue)) for issue in error.issues]
        mend = 'write for example --sigma "0.02 deg"'
        raise InputError([replace(i, mend=mend) if i.key == ("--sigma",) else i for i in issues]) from None


def _named_as_option(issue: Issue) -> Issue:
    option = _OPTION_OF.get(issue.key[:2])
    return replace(issue, key=(option, *issue.key[2:])) if option and not issue.file else issue


def requested_posture(text: str, robot: Robot) -> dict[str, float]:
    """Joint name -> value [rad or m] of ``"90 deg, -180 deg"`` or ``"joint1=90 deg, joint2=-180 deg"``.

    Raises:
        InputError: everything wrong with the posture; the message names the joints that are expected.
    """
    pairs = [tuple(part.strip() for part in entry.split("=", 1)) for entry in entries(text) if entry]
    by_name = any(len(pair) == 2 for pair in pairs)
    issues: list[Issue] = []
    if not by_name and len(pairs) != robot.n:
        given = f"{len(pairs)} {'value' if len(pairs) == 1 else 'values'}"
        mend = f"give one value each, in this order: {', '.join(robot.joint_names)}"
        raise InputError(
            Issue(f"{given} for {robot.n} {'joint' if robot.n == 1 else 'joints'}", ("--posture",), text, mend)
        )
    named = pairs if by_name else [(name, *pair) for name, pair in zip(robot.joint_names, pairs, strict=True)]
    posture = {pair[0]: _joint_value(pair, robot, issues) for pair in named}
    missing = [name for name in robot.joint_names if name not in posture]
    if missing:
        mend = f"the joints are {', '.join(robot.joint_names)}"
        issues.append(Issue(f"no value for {', '.join(missing)}", ("--posture",), text, mend))
    if len(posture) != len(named):
        issues.append(Issue("a joint is named twice", ("--posture",), text))
    if issues:
        raise InputError(issues)
    return posture


def _joint_value(pair: tuple[str, ...], robot: Robot, issues: list[Issue]) -> float:
    key = ("--posture", pair[0])
    joint = next((joint for joint in robot.joints if joint.name == pair[0]), None)
    if joint is None:
        issues.append(Issue("the robot has no such joint", key, pair[0], did_you_mean(pair[0], robot.joint_names)))
        return 0.0
    if len(pair) == 1:
        issues.append(Issue("no value", key, None, f"write {pair[0]}=0 {'deg' if joint.type == 'revolute' else 'mm'}"))
        return 0.0
    try:
        return parse_quantity(pair[1], "angle" if joint.type == "revolute" else "length")
    except BadValueError as error:
        issues.append(error.issue(key, pair[1]))
        return 0.0


def corner(option: str, text: str | None, issues: list[Issue]) -> tuple[float, float, float] | None:
    """The corner of a box [m] that an option states; what is wrong with it joins ``issues``."""
    if text is None:
        return None
    parts = entries(text)
    values = []
    for part in parts:
        try:
            values.append(parse_quantity(part, "length"))
        except BadValueError as error:
            issues.append(error.issue((option,), part))
    if len(parts) != 3:
        issues.append(
            Issue(f"a corner has three coordinates, {len(parts)} are given", (option,), text, "0.3 m, 0.1 m, 0.2 m")
        )
    return (values[0], values[1], values[2]) if len(values) == 3 else None
