"""From the words of a command line to a robot, a ``Problem`` and what else a command needs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import click

from posture_opt.cli.quantities import entries, exact_note, frame_of, joint_sigmas, quantity_of
from posture_opt.errors import InputError, Issue, KeyPath, listed
from posture_opt.files import builtin_names, is_file, preset_names
from posture_opt.problem.load import builtin_problem, load_problem, problem_from_dict
from posture_opt.problem.problem import Problem
from posture_opt.robot.preset import presets_meant

T = TypeVar("T")

_OPTION_OF: dict[KeyPath, str] = {
    # place in a problem file -> the option that fills it
    ("task", "kind"): "--task",
    ("robot", "name"): "--robot",
    ("robot", "file"): "--robot",
    ("uncertainty", "sigma"): "--sigma",
    ("uncertainty",): "--sigma",
    ("data", "columns"): "--column",
    **{("task", key): f"--{key}" for key in ("position", "direction", "region", "clearance", "tilt", "ordinary")},
    ("task", "tool_axis"): "--tool-axis",
    **{("robot", key): f"--{key}".replace("_", "-") for key in ("base_link", "tip_link", "tool", "base", "payload")},
}


def names_problem_file(robot: str) -> bool:
    """Whether ``--robot`` names a problem file, or a built-in problem."""
    return robot.lower().endswith((".yaml", ".yml")) or (robot not in preset_names() and robot in builtin_names())


@dataclass(frozen=True)
class RobotOptions:
    """The options of a command that speak of the robot, as they were written."""

    robot: str | None = None
    base_link: str | None = None
    tip_link: str | None = None
    sigma: str | None = None
    tool: str | None = None
    base: str | None = None
    payload: str | None = None

    def check(self) -> None:
        """Refuse options that need a robot, or a URDF file, that is not named."""
        if self.robot is None and (self.sigma or self.base_link or self.tip_link):
            text = "--sigma, --base-link and --tip-link go with --robot; a problem file has them inside."
            raise click.UsageError(text)
        if (self.base_link or self.tip_link) and not self.is_robot_file:
            raise click.UsageError("--base-link and --tip-link choose a chain in a URDF file, and --robot names none.")

    @property
    def is_robot_file(self) -> bool:
        """Whether the robot is a file of its own."""
        name = self.robot or ""
        meant = name.lower().endswith((".urdf", ".xml", ".xacro")) or "/" in name or is_file(Path(name))
        return meant and not names_problem_file(name)

    def section(self) -> dict[str, Any]:
        """The section ``robot`` of a preset or a robot file, with tool, base and payload."""
        if self.is_robot_file:
            links = {"base_link": self.base_link, "tip_link": self.tip_link}
            found: dict[str, Any] = {"kind": "urdf", "file": self.robot}
            return {**found, **{key: link for key, link in links.items() if link}, **self.replaced()}
        if self.robot not in preset_names():
            hint = presets_meant(str(self.robot)) or f"known are {listed(preset_names())}"
            hint = f"{hint} Or name a URDF or problem file"
            raise InputError(Issue(f"there is no preset '{self.robot}'", ("--robot",), self.robot, hint))
        return {"kind": "preset", "name": self.robot, **self.replaced()}

    def replaced(self) -> dict[str, Any]:
        """Keys of the section ``robot`` that options state."""
        found: dict[str, Any] = {}
        issues: list[Issue] = []
        for key, text in self._stated.items():
            try:
                if key == "payload" and text is not None:
                    quantity_of("--payload", text, "mass")
                found |= {} if text is None else {key: text if key == "payload" else frame_of(f"--{key}", text)}
            except InputError as error:
                issues += error.issues
        if issues:
            raise InputError(issues)
        return found

    def notes(self, former: Mapping[str, Any]) -> tuple[str, ...]:
        """Notes on these keys, of which a file's section ``robot`` may state some too."""
        instead = {key: ", in place of the file's" if former.get(key) is not None else "" for key in self._stated}
        return tuple(f"{key} from the command line: {text}{instead[key]}" for key, text in self._stated.items() if text)

    @property
    def _stated(self) -> dict[str, str | None]:
        return {"tool": self.tool, "base": self.base, "payload": self.payload}


def with_robot_options(problem: Problem, options: RobotOptions) -> Problem:
    """The problem with the tool, base and payload of the command line in place of its own; notes say so."""
    keys = options.replaced()
    if not keys:
        return problem
    former = problem.to_dict()["robot"]
    kept = {
        name: value for name, value in (former.get("corrections") or {}).items() if name.rpartition(".")[0] not in keys
    }
    found = problem.with_robot({**former, **keys, **({"corrections": kept} if "corrections" in former else {})})
    if "payload" in keys and problem.task is not None and problem.task.payload is not None:
        found = found.with_task(payload=keys["payload"])
    overridden = problem.overridden | {("robot", key) for key in keys}
    new = options.notes({**former, **({"payload": 0} if "payload" in (problem.document.get("task") or {}) else {})})
    notes = tuple(dict.fromkeys((*problem.notes, *found.notes, *new)))
    return replace(found, origin=problem.origin, overridden=overridden, notes=notes)


def robot_of_problem_file(options: RobotOptions) -> Problem:
    """The robot of a problem file, what is uncertain about it and its effects, without task and cell."""
    assert options.robot is not None
    source = load_problem(options.robot)
    document = source.to_dict()
    if options.sigma and document.get("uncertainty"):
        raise click.UsageError(f"{options.robot} states the uncertainty of its robot: leave out --sigma.")
    found = source.of_robot()
    unused = [key for key in ("task", "cell") if document.get(key)]
    note = f"robot and uncertainty of {options.robot}" + (f"; its {' and '.join(unused)} left out" if unused else "")
    return with_robot_options(replace(found, notes=(*found.notes, note)), options)


def requested_problem(
    problem: str | None, robot: str | None = None, task: str | None = None, **given: str | None
) -> Problem:
    """The problem that the options describe: a file, a robot with a task, or the built-in problem of a task."""
    if problem and robot:
        raise click.UsageError("--problem and --robot both name a robot: keep one of them.")
    options = RobotOptions(robot, **{f.name: given.pop(f.name, None) for f in fields(RobotOptions)[1:]})
    options.check()
    goal = _goal(given)
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
    stated = {key: text for key, text in given.items() if text}
    goal: dict[str, Any] = {key: stated[key] for key in ("clearance", "tilt", "ordinary") if key in stated}
    goal |= {key: entries(stated[key]) for key in ("position", "direction", "tool_axis") if key in stated}
    if "region" in stated:
        low, _, high = stated["region"].partition(" to ")
        goal["region"] = {"min": entries(low), "max": entries(high)}
    if "link_height" in stated:
        quantity_of("--link-height", stated["link_height"])
    terms = [{"kind": key, "at_least": stated[key]} for key in ("link_height", "limit_margin") if key in stated]
    return goal | ({"subject_to": terms} if terms else {})


def _problem_of_robot(options: RobotOptions, task: str | None, goal: dict[str, Any]) -> Problem:
    if goal and not task:
        raise click.UsageError("Options of a target belong to a task: name it with --task.")
    if names_problem_file(str(options.robot)):
        known = robot_of_problem_file(options)
        return _with_sigma(known.with_task(task, **goal) if task else known, options)
    section = options.section()
    data: dict[str, Any] = {"name": f"{task or 'robot'}: {Path(str(options.robot)).stem}", "robot": section}
    if task:
        data["task"] = {"kind": task, **goal}
    problem = _with_sigma(problem_from_dict(data), options)
    return replace(problem, notes=(*problem.notes, *options.notes({})))


def _with_sigma(problem: Problem, options: RobotOptions) -> Problem:
    if not options.sigma:
        return problem
    joints = problem.robot.joints
    sigma = joint_sigmas(options.sigma, joints)
    found = problem.with_sigma(sigma)
    return replace(found, notes=(*found.notes, *exact_note(joints, sigma)))


def with_columns(problem: Problem, columns: Mapping[str, str | int]) -> Problem:
    """The problem that reads these columns of measurements too, in place of what its file says of them."""
    if not columns:
        return problem
    former = (problem.document.get("data") or {}).get("columns") or {}
    return _as_options(lambda: problem.replace(data__columns={**former, **columns}))


def problem_of_data(data: Path, columns: Mapping[str, str | int] | None = None, **given: str | None) -> Problem:
    """The problem for measurements of a robot without a problem file: its frames are free."""
    options = RobotOptions(**given)
    options.check()
    section = options.section()
    stated = {}
    if options.sigma:
        joints = _as_options(lambda: problem_from_dict({"robot": section})).robot.joints
        stated["sigma"] = joint_sigmas(options.sigma, joints)
    # Loads what reads measurements.
    build: Callable[..., Problem] = import_module("posture_opt.problem.measured_robot").problem_of_measured_robot
    return _as_options(lambda: build(section, data, stated, columns))


def _as_options(build: Callable[[], T]) -> T:
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
        hint = 'write for example --sigma "0.02 deg", or write a file with the data sheet\'s repeatability: new'
        raise InputError([replace(i, hint=hint) if i.key == ("--sigma",) else i for i in issues]) from None


def _named_as_option(issue: Issue) -> Issue:
    option = _OPTION_OF.get(issue.key[:2])
    return replace(issue, key=(option, *issue.key[2:])) if option and not issue.file else issue
