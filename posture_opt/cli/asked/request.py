"""From the words of a command line to a ``Problem`` and a posture.

Options state what a file states, and go through the same schema; complaints then name the option.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import click

from posture_opt.cli.asked.quantities import entries, exact_note, height_of, joint_sigmas
from posture_opt.cli.asked.robot_options import RobotOptions, robot_of_problem_file, with_robot_options
from posture_opt.errors import InputError, Issue, KeyPath
from posture_opt.problem.load import builtin_problem, load_problem, problem_from_dict
from posture_opt.problem.measured_robot import problem_of_measured_robot
from posture_opt.problem.problem import Problem

T = TypeVar("T")

_OPTION_OF: dict[KeyPath, str] = {
    # place in a problem file -> the option that fills it
    ("task", "kind"): "--task",
    ("task", "position"): "--position",
    ("task", "direction"): "--direction",
    ("task", "region"): "--region",
    ("task", "clearance"): "--clearance",
    ("task", "tool_axis"): "--tool-axis",
    ("task", "tilt"): "--tilt",
    ("robot", "name"): "--robot",
    ("robot", "file"): "--robot",
    ("robot", "base_link"): "--base-link",
    ("robot", "tip_link"): "--tip-link",
    ("robot", "tool"): "--tool",
    ("robot", "base"): "--base",
    ("robot", "payload"): "--payload",
    ("uncertainty", "sigma"): "--sigma",
    ("uncertainty",): "--sigma",
    ("data", "columns"): "--column",
}


def requested_problem(
    problem: str | None,
    robot: str | None = None,
    base_link: str | None = None,
    tip_link: str | None = None,
    sigma: str | None = None,
    tool: str | None = None,
    base: str | None = None,
    payload: str | None = None,
    task: str | None = None,
    **goal_options: str | None,
) -> Problem:
    """The problem that the options describe.

    A problem file, a robot with a task, or the built-in problem of a task; further options replace what it states.

    Args:
        problem: file or name of a built-in problem; ``robot`` preset or file, one of both.
        task: its kind; ``goal_options`` the others of `task_options`. All are texts with units, as in a file.

    Raises:
        InputError: what the options or the file say does not fit.
        UsageError: options that exclude each other, or none that names a robot.
    """
    if problem and robot:
        raise click.UsageError("--problem and --robot both name a robot: keep one of them.")
    options = RobotOptions(robot, base_link, tip_link, sigma, tool, base, payload)
    options.check()
    goal = _goal(goal_options)
    if robot:
        return _as_options(lambda: _problem_of_robot(options, task, goal))
    if problem:
        chosen = load_problem(problem)
    elif task:
        chosen = _as_options(lambda: builtin_problem(task))
    else:
        raise click.UsageError("Name a --problem or a --robot.")
    if terms := goal.get("subject_to"):
        former, kinds = (chosen.document.get("task") or {}).get("subject_to") or [], {term["kind"] for term in terms}
        goal["subject_to"] = [*(term for term in former if term["kind"] not in kinds), *terms]
    chosen = _as_options(lambda: with_robot_options(chosen, options))
    return _as_options(lambda: chosen.with_task(task, **goal)) if task or goal else chosen


def _goal(given: Mapping[str, str | None]) -> dict[str, Any]:
    """Keys of the task that options state."""
    stated = {key: text for key, text in given.items() if text}
    goal: dict[str, Any] = {key: stated[key] for key in ("clearance", "tilt") if key in stated}
    goal |= {key: entries(stated[key]) for key in ("position", "direction", "tool_axis") if key in stated}
    if "region" in stated:
        low, _, high = stated["region"].partition(" to ")
        goal["region"] = {"min": entries(low), "max": entries(high)}
    if "link_height" in stated:
        height_of(stated["link_height"])
    terms = [{"kind": key, "at_least": stated[key]} for key in ("link_height", "limit_margin") if key in stated]
    return goal | ({"subject_to": terms} if terms else {})


def _problem_of_robot(options: RobotOptions, task: str | None, goal: dict[str, Any]) -> Problem:
    """The problem of ``--robot``, with a task or without.

    A problem file gives robot, uncertainty and effects; a preset or URDF file the robot alone.

    Raises:
        UsageError: a target without a task.
    """
    if goal and not task:
        raise click.UsageError("Options of a target belong to a task: name it with --task.")
    if options.is_problem_file:
        known = robot_of_problem_file(options)
        return _with_sigma(known.with_task(task, **goal) if task else known, options)
    section = options.section()
    data: dict[str, Any] = {"name": f"{task or 'robot'}: {Path(str(options.robot)).stem}", "robot": section}
    if task:
        data["task"] = {"kind": task, **goal}
    problem = _with_sigma(problem_from_dict(data), options)
    return replace(problem, notes=(*problem.notes, *options.notes({})))


def _with_sigma(problem: Problem, options: RobotOptions) -> Problem:
    """The problem with the scatter of every joint that ``--sigma`` states, if it does."""
    if not options.sigma:
        return problem
    joints = problem.robot.joints
    sigma = joint_sigmas(options.sigma, joints)
    found = problem.with_sigma(sigma)
    return replace(found, notes=(*found.notes, *exact_note(joints, sigma)))


def with_columns(problem: Problem, columns: Mapping[str, str | int]) -> Problem:
    """The problem that reads these columns of measurements too, in place of what its file says of them.

    Raises:
        InputError: names that no column of this robot's measurements has.
    """
    if not columns:
        return problem
    former = (problem.document.get("data") or {}).get("columns") or {}
    return _as_options(lambda: problem.replace(data__columns={**former, **columns}))


def problem_of_data(data: Path, columns: Mapping[str, str | int] | None = None, **given: str | None) -> Problem:
    """The problem for measurements of a robot without a problem file: its frames are free.

    Args:
        data: the measurements.
        columns: column headers, as in the section ``data``.
        given: the fields of ``RobotOptions``.

    Raises:
        InputError: the options do not fit, or the file cannot be read.
        UsageError: links of a preset.
    """
    options = RobotOptions(**given)
    options.check()
    section = options.section()
    stated = {}
    if options.sigma:
        joints = _as_options(lambda: problem_from_dict({"robot": section})).robot.joints
        stated["sigma"] = joint_sigmas(options.sigma, joints)
    return _as_options(lambda: problem_of_measured_robot(section, data, stated, columns))


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
        hint = 'write for example --sigma "0.02 deg"'
        raise InputError([replace(i, hint=hint) if i.key == ("--sigma",) else i for i in issues]) from None


def _named_as_option(issue: Issue) -> Issue:
    """An issue by the option that filled its key; as it is where a file says it."""
    option = _OPTION_OF.get(issue.key[:2])
    return replace(issue, key=(option, *issue.key[2:])) if option and not issue.file else issue
