"""``optimize-posture schema``: the JSON Schema of the problem file, for editors that complete and check."""

from __future__ import annotations

import json
from pathlib import Path

import click

from posture_opt.cli.output import write_text
from posture_opt.problem.schema import json_schema


@click.command("schema")
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="Write it to a file.")
@click.option("--debug", is_flag=True, hidden=True)
def command(out: Path | None, debug: bool) -> None:
    """Print the JSON Schema of the problem file.

    An editor with a YAML language server checks and completes a problem file that begins with
    '# yaml-language-server: $schema=problem.schema.json'.
    """
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **json_schema()}
    write_text(out, json.dumps(schema, indent=2, ensure_ascii=False) + "\n")
