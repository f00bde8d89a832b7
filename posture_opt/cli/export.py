"""``optimize-posture export``: the arm, its covariance as code, its posture as a program."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

import posture_opt as po
from posture_opt.cli.options import Common, common_options, problem_options, task_options
from posture_opt.cli.output import OUT, output, show
from posture_opt.cli.progress import progress_bar
from posture_opt.cli.quantities import requested_posture
from posture_opt.cli.request import placed, requested_problem
from posture_opt.cli.robot_programs import motion_options
from posture_opt.export.export_files import export_kinds
from posture_opt.output import write_folder


@click.command("export")
@problem_options
@task_options
@click.option("--to", type=click.Choice(list(export_kinds())), required=True, help="The format: see below.")
@click.option("--name", default="", metavar="NAME", help="Of functions, programs and files.")
@click.option("--posture", metavar="TEXT", help="Stop of a robot program; default: the best posture, planned.")
@motion_options(0.0)
@common_options
def export_command(
    common: Common, to: str, name: str, posture: str | None, speed: float, wait: float, **given: str | None
) -> None:
    problem = requested_problem(**given)
    q = None if posture is None else requested_posture(posture, problem.robot)
    with output(common), placed(problem):
        with progress_bar(common, "exporting"):
            found = po.export_files(
                problem, to, name=name, posture=q, speed=speed, wait=wait, seed=common.seed, workers=common.workers
            )
        if common.out is not None:
            write_files(common.out, found.files)

    def report() -> str:
        if common.out is None:
            return "\n".join(found.files.values())
        return "\n".join(
            [f"written to {common.out}: {', '.join(found.files)}", *(f"Note: {n.rstrip('.')}." for n in found.notes)]
        )

    show(common, lambda: {"target": to, "files": dict(found.files), "notes": list(found.notes)}, report)


export_command.help = f"""The arm, its covariance as code, or its posture as a robot program, in another format.

\b
{"".join(f"{kind:<11} {listed.summary}" + chr(10) for kind, listed in export_kinds().items())}
Joint values are those of the joints of the model, with its zeros and directions.
"""


def write_files(out: Path, files: Mapping[str, str]) -> None:
    """Write files by name into a folder, all or none."""
    write_folder(out, {file: text.encode() for file, text in files.items()}, OUT)
