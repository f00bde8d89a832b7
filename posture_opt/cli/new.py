"""``optimize-posture new``: a commented problem file to start from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from posture_opt.cli.output import write_text
from posture_opt.errors import InputError, Issue
from posture_opt.problem.starter import starter_text
from posture_opt.robot import preset_names


@click.command("new")
@click.argument("preset", required=False)
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="Write it to a file.")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
@click.option("--debug", is_flag=True, hidden=True)
def command(preset: str | None, out: Path | None, force: bool, debug: bool) -> None:
    """Print a commented problem file for PRESET, which solves as it is."""
    if preset is None:
        raise click.UsageError(f"Name a preset: {', '.join(preset_names())}.")
    try:
        text = starter_text(preset)
    except InputError as error:
        raise InputError([replace(issue, key=("PRESET",)) for issue in error.issues]) from None
    if out is not None and out.exists() and not force:
        raise InputError(
            Issue(f"{out} exists", ("--out",), str(out), "choose another name, or replace it with --force")
        )
    write_text(out, text)
