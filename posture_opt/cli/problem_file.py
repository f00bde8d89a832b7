"""Commands that state what a problem file may contain: ``list``, ``new`` and ``schema``."""

from __future__ import annotations

from pathlib import Path

import click

from posture_opt.cli import deferred
from posture_opt.cli.completion import PATH, ROBOT
from posture_opt.cli.options import debug_option
from posture_opt.cli.output import write_text
from posture_opt.files import preset_names


@click.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print the JSON document and nothing else.")
@click.option("--statements", is_flag=True, help="List what results can say, by id, with severity and sentence.")
@debug_option
def list_command(as_json: bool, statements: bool) -> None:
    """List tasks, effects, presets, solvers, terms, exports and built-in problems."""
    texts = deferred.problem_texts
    click.echo(texts.statement_listing(as_json) if statements else texts.listing(as_json))


@click.command("new")
@click.argument("robot", required=False, type=ROBOT, metavar="PRESET|FILE")
@click.option("--base-link", metavar="LINK", help="First link of the chain in the URDF file.")
@click.option("--tip-link", metavar="LINK", help="Last link of the chain in the URDF file.")
@click.option("--out", type=PATH, metavar="FILE", help="Write it to a file.")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
@debug_option
def new_command(robot: str | None, base_link: str | None, tip_link: str | None, out: Path | None, force: bool) -> None:
    """Print a commented problem file for a preset, a URDF or a controller's calibration, which solves as it is."""
    if robot is None:
        raise click.UsageError(f"Name a preset: {', '.join(preset_names())}; or a URDF file.")
    write_text(out, deferred.problem_texts.starter(robot, base_link, tip_link, out, force))


@click.command("schema")
@click.option("--out", type=PATH, metavar="FILE", help="Write it to a file.")
@debug_option
def schema_command(out: Path | None) -> None:
    """Print the JSON Schema of the problem file.

    An editor with a YAML language server checks and completes a problem file that begins with
    '# yaml-language-server: $schema=problem.schema.json'.
    """
    write_text(out, deferred.problem_texts.schema_text(out))
