"""``optimize-posture export``: the arm, its covariance as code, its posture as a program.

Without ``--out`` the files are printed one after the other; with it their names and the notes are.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.asked.options import Common, common_options, problem_options, task_options
from posture_opt.cli.output import OUT, output, show
from posture_opt.cli.progress import progress_bar
from posture_opt.cli.robot_programs import approach_option, motion_options
from posture_opt.export import ARM_FORMATS, PROGRAM_FORMATS
from posture_opt.output import write_folder

_JOINTS = "Joint values are those of the joints of the model, with its zeros and directions."


class ExportCommand(click.Command):
    """The command with the formats in its help, which are read when it is shown."""

    @property
    def help(self) -> str:
        """The help text: what the command does, and a line a format."""
        formats = "\n".join(f"{kind:<11} {listed.summary}" for kind, listed in deferred.export_kinds().items())
        return f"{self._help}\n\n\b\n{formats}\n\n{_JOINTS}\n"

    @help.setter
    def help(self, text: str) -> None:
        self._help = text


@click.command("export", cls=ExportCommand)
@problem_options
@task_options
@click.option("--to", type=click.Choice([*ARM_FORMATS, *PROGRAM_FORMATS]), required=True, help="The format: see below.")
@click.option("--name", default="", metavar="NAME", help="Of functions, programs and files.")
@approach_option
@click.option("--with-breaks", is_flag=True, help="Write a path that the arm has to leave on its way in parts.")
@click.option("--posture", metavar="TEXT", help="Stop of a robot program; default: the best posture, planned.")
@motion_options(0.0)
@common_options
def export_command(
    common: Common, to: str, name: str, approach: str | None, posture: str | None, speed: float, wait: float,
    with_breaks: bool, **given: str | None,
) -> None:  # fmt: skip
    """The arm, its covariance as code, or its posture as a robot program, in another format."""
    problem = deferred.requested_problem(**given)
    distance = None if approach is None else deferred.distance_of("--approach", approach)
    q = None if posture is None else deferred.requested_posture(posture, problem.robot)
    with output(common), deferred.placed(problem):
        with progress_bar(common, "exporting"):
            found = po.export_files(
                problem, to, name=name, posture=q, speed=speed, wait=wait, approach=distance,
                with_breaks=with_breaks, seed=common.seed, workers=common.workers,
            )  # fmt: skip
        if common.out is not None:
            write_files(common.out, found.files)

    def report() -> str:
        if common.out is None:
            return "\n".join(found.files.values())
        return "\n".join(
            [f"written to {common.out}: {', '.join(found.files)}", *(f"Note: {n.rstrip('.')}." for n in found.notes)]
        )

    show(common, lambda: {"target": to, "files": dict(found.files), "notes": list(found.notes)}, report)


def write_files(out: Path, files: Mapping[str, str]) -> None:
    """Write files by name into a folder, all or none.

    Raises:
        InputError: the folder cannot be written to.
    """
    write_folder(out, {file: text.encode() for file, text in files.items()}, OUT)
