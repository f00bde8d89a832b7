"""``optimize-posture export`` and ``compensate``: the arm, its code, and programs through its postures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.completion import PATH
from posture_opt.cli.options import (
    POSTURE_HELP,
    Command,
    Common,
    add_options,
    common_options,
    problem_options,
    task_options,
)
from posture_opt.cli.output import OUT, output, save_result, show, show_result
from posture_opt.cli.progress import progress_bar
from posture_opt.export import ARM_FORMATS, PROGRAM_FORMATS
from posture_opt.output import write_folder

if TYPE_CHECKING:
    from posture_opt.export.robot_program import RobotProgram


@dataclass(frozen=True)
class ProgramRequest:
    """What is asked of a robot program.

    Args:
        motion: speed in percent of what the language takes for full, wait at every stop [s], and approach [m].
    """

    kind: str | None
    motion: Mapping[str, float | None]

    def files(self, common: Common, name: str, program: Callable[..., RobotProgram]) -> dict[str, bytes]:
        """The program of ``program(speed=…, wait=…)`` by file name; nothing where none is asked for."""
        if self.kind is None:
            return {}
        if common.out is None:
            raise click.UsageError("--program goes with --out DIR, which it is written to.")
        found = deferred.export_files.program_files(program(**self.motion), self.kind, name)
        return {file: text.encode() for file, text in found.files.items()}


def motion_options(wait: float) -> Callable[[Command], Command]:
    """Adds the options of robot programs: speed [percent] and wait [s] at every stop, with its default."""

    def added(command: Command) -> Command:
        return add_options(
            command,
            click.option(
                "--speed", type=click.FloatRange(0, 100, min_open=True), default=10.0, show_default=True,
                metavar="PERCENT", help="Speed of a robot program.",
            ),
            click.option(
                "--wait", type=click.FloatRange(min=0), default=wait, show_default=True, metavar="SECONDS",
                help="Wait at every stop of a robot program.",
            ),
        )  # fmt: skip

    return added


def approach_option(command: Command) -> Command:
    """Adds ``--approach`` of programs whose stops touch something."""
    option = click.option(
        "--approach", metavar="LENGTH",
        help="Straight approach to each stop, and retract: \"30 mm\".  [default: 50 mm if the task touches]",
    )  # fmt: skip
    return add_options(command, option)


def program_options(wait: float, touching: bool = False) -> Callable[[Command], Command]:
    """Adds the options of a program that is written with other files; the command gets them as ``motion``.

    Args:
        wait: default at every stop [s].
    """

    def added(command: Command) -> Command:
        @wraps(command)
        def with_motion(*args: Any, program: str | None, speed: float, wait: float, **others: Any) -> Any:
            motion: dict[str, float | None] = {"speed": speed, "wait": wait}
            if touching:
                given = others.pop("approach")
                motion["approach"] = None if given is None else deferred.quantities.distance_of("--approach", given)
            return command(*args, motion=ProgramRequest(program, motion), **others)

        option = click.option(
            "--program", type=click.Choice(list(PROGRAM_FORMATS)),
            help="Also write a robot program through the postures.",
        )  # fmt: skip
        found = add_options(motion_options(wait)(with_motion), option)
        return approach_option(found) if touching else found

    return added


@click.command("compensate")
@click.argument("targets", type=PATH, metavar="TARGETS.csv")
@program_options(0.0, touching=True)
@problem_options
@common_options
def compensate_command(common: Common, targets: Path, motion: ProgramRequest, **given: str | None) -> None:
    """Compute joint values that bring the tool of this arm, with its errors, to the targets.

    TARGETS.csv has x, y, z with units, and optionally qw, qx, qy, qz. Joint columns beside them give the posture to
    stay near. Joint columns alone mean the pose of the nominal arm. Without joint columns, the task's tool axis, tilt
    and requirements hold, near its posture. The arm keeps clear of the cell either way. JOINT.approach and payload
    count as in measurements. The answer, compensated.csv, has the rows of the targets in their units.
    """
    problem = deferred.request.requested_problem(**given)
    with output(common), deferred.request.placed(problem):
        with progress_bar(common, "compensating"):
            found = po.compensate(problem, targets)
        program = motion.files(common, "compensated", partial(deferred.robot_program.compensated_program, found))
        save_result(common, found, program)
    show_result(common, found)


class ExportCommand(click.Command):
    """The command with the formats in its help, which are read when it is shown."""

    @property
    def help(self) -> str:
        """The help text: what the command does, and a line a format."""
        kinds = deferred.export_files.export_kinds()
        formats = "\n".join(f"{kind:<11} {listed.summary}" for kind, listed in kinds.items())
        joints = "Joint values use the zeros and directions of the model."
        return f"{self._help}\n\n\b\n{formats}\n\n{joints}\n"

    @help.setter
    def help(self, text: str) -> None:
        self._help = text


@click.command("export", cls=ExportCommand)
@click.option(
    "--to", type=click.Choice([*ARM_FORMATS, *PROGRAM_FORMATS]), required=True, help="The format, from the list above."
)
@click.option("--name", default="", metavar="NAME", help="Name of functions, programs and files.")
@approach_option
@click.option("--with-breaks", is_flag=True, help="Write a path in parts if the arm must leave it on the way.")
@click.option("--posture", metavar="TEXT", help=f"Stop of a robot program: {POSTURE_HELP} [default: the best posture]")
@motion_options(0.0)
@problem_options
@task_options
@common_options
def export_command(
    common: Common, to: str, name: str, approach: str | None, posture: str | None, speed: float, wait: float,
    with_breaks: bool, **given: str | None,
) -> None:  # fmt: skip
    """Export the arm, its covariance as code, or its best posture as a robot program."""
    problem = deferred.request.requested_problem(**given)
    distance = None if approach is None else deferred.quantities.distance_of("--approach", approach)
    q = None if posture is None else deferred.quantities.requested_posture(posture, problem.robot)
    with output(common), deferred.request.placed(problem):
        with progress_bar(common, "exporting"):
            found = po.export_files(
                problem, to, name=name, posture=q, speed=speed, wait=wait, approach=distance,
                with_breaks=with_breaks, seed=common.seed, workers=common.workers,
            )  # fmt: skip
        if common.out is not None:
            write_folder(common.out, {file: text.encode() for file, text in found.files.items()}, OUT)

    def report() -> str:
        if common.out is None:
            return "\n".join(found.files.values())
        notes = [f"Note: {note.rstrip('.')}." for note in found.notes]
        return "\n".join([f"written to {common.out}: {', '.join(found.files)}", *notes])

    show(common, lambda: {"target": to, "files": dict(found.files), "notes": list(found.notes)}, report)
