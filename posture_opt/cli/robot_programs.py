"""Robot programs written with the files of other commands: their options, and the files."""

from __future__ import annotations

from collections.abc import Callable
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
        speed: percent of what the language takes for full; ``wait`` at every stop [s].
    """

    kind: str | None
    speed: float
    wait: float

    def files(self, common: Common, name: str, program: Callable[[float, float], RobotProgram]) -> dict[str, bytes]:
        """The program of ``program(speed, wait)`` by file name; nothing where none is asked for.

        Raises:
            UsageError: a program without a folder.
            InputError: the language cannot say it.
        """
        if self.kind is None:
            return {}
        if common.out is None:
            raise click.UsageError("--program goes with --out DIR, which it is written to.")
        found = deferred.program_files(program(self.speed, self.wait), self.kind, name)
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


def program_options(wait: float) -> Callable[[Command], Command]:
    """Adds the options of a program that is written with other files; the command gets them as ``motion``.

    Args:
        wait: default at every stop [s].
    """

    def added(command: Command) -> Command:
        @wraps(command)
        def with_motion(*args: Any, program: str | None, speed: float, wait: float, **others: Any) -> Any:
            return command(*args, motion=ProgramRequest(program, speed, wait), **others)

        option = click.option(
            "--program", type=click.Choice(list(PROGRAM_FORMATS)),
            help="Write a robot program through the postures too.",
        )  # fmt: skip
        return add_options(motion_options(wait)(with_motion), option)

    return added
