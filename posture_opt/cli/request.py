"""From the words of a command line to a ``Problem`` and a posture."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import click

from posture_opt.cli.quantities import entries, exact_note, height_of, joint_sigmas
from posture_opt.errors import InputError, Issue, KeyPath, did_you_mean
from posture_opt.problem.load import builtin_problem, load_problem, problem_from_dict
from posture_opt.problem.measured_robot import problem_of_measured_robot
from posture_opt.problem.problem import Problem
from posture_opt.robot import preset_names

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
        chosen = load_problem(problem)
    elif task:
        chosen = _as_options(lambda: builtin_problem(task))
    else:
        raise click.UsageError("Name a --problem or a --robot.")
    if link_height:
        former = (chosen.document.get("task") or {}).get("subject_to") or []
        goal["subject_to"] = [*(term for term in former if term["kind"] != "link_height"), *goal["subject_to"]]
    return _as_options(lambda: chosen.with_task(task, **goal)) if task or goal else chosen


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


def problem_of_data(
    data: Path, robot: str, base_link: str | None = None, tip_link: str | None = None, sigma: str | None = None
) -> Problem:
    """The problem that measurements of a robot without a problem file stand for: its frames are free.

    Raises:
        InputError: the options do not fit, or the file cannot be read.
        UsageError: links of a preset.
    """
    section = _robot_section(robot, base_link, tip_link)
    stated = {}
    if sigma:
        joints = _as_options(lambda: problem_from_dict({"robot": section})).robot.joints
        stated["sigma"] = joint_sigmas(sigma, joints)
    return _as_options(lambda: problem_of_measured_robot(section, data, stated))


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
