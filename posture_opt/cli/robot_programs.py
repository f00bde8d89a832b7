"""Robot programs written with the files of other commands: their options, and the files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from posture_opt.cli import deferred
from posture_opt.cli.asked.options import Command, Common, add_options
from posture_opt.export import PROGRAM_FORMATS

if TYPE_CHECKING:
    from posture_opt.export.robot_program import RobotProgram


@dataclass(frozen=True)
class ProgramRequest:
    """What is asked of a robot program.

    Args:
        kind: its language, as ``--to`` of ``export`` names it; None: no program.
        motion: speed in percent of what the language takes for full, wait at every stop [s], and approach [m].
    """

    kind: str | None
    motion: Mapping[str, float | None]

    def files(self, common: Common, name: str, program: Callable[..., RobotProgram]) -> dict[str, bytes]:
        """The program of ``program(speed=…, wait=…)`` by file name; nothing where none is asked for.

        Raises:
            UsageError: a program without a folder.
            InputError: the language cannot say it.
        """
        if self.kind is None:
            return {}
        if common.out is None:
            raise click.UsageError("--program goes with --out DIR, which it is written to.")
        found = deferred.program_files(program(**self.motion), self.kind, name)
        return {file: text.encode() for file, text in found.files.items()}


def motion_options(wait: float) -> Callable[[Command], Command]:
    """Adds the options of robot programs: speed [percent] and wait [s] at every stop, with its default."""

    def added(command: Command) -> Command:
        return add_options(
            command,
            click.option(
                "--speed", type=click.FloatRange(0, 100, min_open=True), default=10.0, show_default=True,
                metavar="PERCENT", help="Of a robot program.",
            ),
            click.option(
                "--wait", type=click.FloatRange(min=0), default=wait, show_default=True, metavar="SECONDS",
                help="At every stop of a robot program.",
            ),
        )  # fmt: skip

    return added


def approach_option(command: Command) -> Command:
    """Adds ``--approach`` of programs whose stops touch something."""
    option = click.option(
        "--approach", metavar="LENGTH",
        help="Come from that far in front of each stop on a line, and back; default: 50 mm where the task touches.",
    )  # fmt: skip
    return add_options(command, option)


def program_options(wait: float, touching: bool = False) -> Callable[[Command], Command]:
    """Adds the options of a program that is written with other files; the command gets them as ``motion``.

    Args:
        wait: default at every stop [s].
        touching: whether the stops may touch something.
    """

    def added(command: Command) -> Command:
        @wraps(command)
        def with_motion(*args: Any, program: str | None, speed: float, wait: float, **others: Any) -> Any:
            motion: dict[str, float | None] = {"speed": speed, "wait": wait}
            if touching:
                given = others.pop("approach")
                motion["approach"] = None if given is None else deferred.distance_of("--approach", given)
            return command(*args, motion=ProgramRequest(program, motion), **others)

        option = click.option(
            "--program", type=click.Choice(list(PROGRAM_FORMATS)),
            help="Write a robot program through the postures too.",
        )  # fmt: skip
        found = add_options(motion_options(wait)(with_motion), option)
        return approach_option(found) if touching else found

    return added
