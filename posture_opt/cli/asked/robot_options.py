"""What a command line says of the robot: where it is from, and what of it is used in place of the file's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from posture_opt.cli.asked.quantities import frame_of, payload_of
from posture_opt.errors import InputError, Issue, listed
from posture_opt.files import is_file
from posture_opt.problem.load import builtin_names, load_problem
from posture_opt.problem.problem import Problem
from posture_opt.robot import preset_names
from posture_opt.robot.preset import presets_meant

_PROBLEM_FILES = (".yaml", ".yml")
_ROBOT_FILES = (".urdf", ".xml", ".xacro")


def names_problem_file(robot: str) -> bool:
    """Whether ``--robot`` names a problem file, or a built-in problem."""
    return robot.lower().endswith(_PROBLEM_FILES) or (robot not in preset_names() and robot in builtin_names())


@dataclass(frozen=True)
class RobotOptions:
    """The options of a command that speak of the robot, as they were written.

    Args:
        robot: a preset, a URDF file, or a problem file whose robot is taken.
        base_link, tip_link: the ends of the chain in a URDF file.
        sigma: standard deviation of every joint; ``tool``, ``base``: frames; ``payload``: a mass.
    """

    robot: str | None = None
    base_link: str | None = None
    tip_link: str | None = None
    sigma: str | None = None
    tool: str | None = None
    base: str | None = None
    payload: str | None = None

    def check(self) -> None:
        """Whether the options fit each other.

        Raises:
            UsageError: options that need a robot, or a URDF file, that is not named.
        """
        if self.robot is None and (self.sigma or self.base_link or self.tip_link):
            raise click.UsageError(
                "--sigma, --base-link and --tip-link go with --robot; a problem file has them inside."
            )
        if (self.base_link or self.tip_link) and not self.is_robot_file:
            raise click.UsageError("--base-link and --tip-link choose a chain in a URDF file, and --robot names none.")

    @property
    def is_problem_file(self) -> bool:
        """Whether the robot is that of a problem file."""
        return names_problem_file(self.robot or "")

    @property
    def is_robot_file(self) -> bool:
        """Whether the robot is a file of its own."""
        name = self.robot or ""
        return not self.is_problem_file and (name.lower().endswith(_ROBOT_FILES) or "/" in name or is_file(Path(name)))

    def section(self) -> dict[str, Any]:
        """The section ``robot`` of a preset or a robot file, with tool, base and payload.

        Raises:
            InputError: there is no such preset, or an option holds no frame or mass.
        """
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
        """Keys of the section ``robot`` that options state.

        Raises:
            InputError: no frame, no mass, or a number without its unit.
        """
        found: dict[str, Any] = {}
        issues: list[Issue] = []
        for key, text, read in (
            ("tool", self.tool, lambda text: frame_of("--tool", text)),
            ("base", self.base, lambda text: frame_of("--base", text)),
            ("payload", self.payload, payload_of),
        ):
            try:
                found |= {} if text is None else {key: read(text)}
            except InputError as error:
                issues += error.issues
        if issues:
            raise InputError(issues)
        return found

    def notes(self, former: Mapping[str, Any]) -> tuple[str, ...]:
        """Notes on these keys, of which a file's section ``robot`` may state some too."""
        stated = {"tool": self.tool, "base": self.base, "payload": self.payload}
        instead = {key: ", in place of the file's" if former.get(key) is not None else "" for key in stated}
        return tuple(f"{key} from the command line: {text}{instead[key]}" for key, text in stated.items() if text)


def with_robot_options(problem: Problem, options: RobotOptions) -> Problem:
    """The problem with the tool, base and payload of the command line in place of its own; notes say so.

    Corrections of a frame that is replaced are those of another frame, and go with it.

    Raises:
        InputError: an option holds no frame or mass.
    """
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
    """The robot of a problem file, what is uncertain about it and its effects, without task and cell.

    Raises:
        InputError: everything wrong with the file.
        UsageError: a scatter in addition to that of the file.
    """
    assert options.robot is not None
    source = load_problem(options.robot)
    document = source.to_dict()
    if options.sigma and document.get("uncertainty"):
        raise click.UsageError(f"{options.robot} states the uncertainty of its robot: leave out --sigma.")
    found = source.of_robot()
    unused = [key for key in ("task", "cell") if document.get(key)]
    note = f"robot and uncertainty of {options.robot}" + (f"; its {' and '.join(unused)} left out" if unused else "")
    return with_robot_options(replace(found, notes=(*found.notes, note)), options)
