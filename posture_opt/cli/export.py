"""``optimize-posture export``: the covariance of the tool point as code for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from posture_opt.cli.options import Common, common_options, problem_options
from posture_opt.cli.output import OUT, output, show
from posture_opt.cli.request import placed, requested_problem
from posture_opt.output import staged_folder
from posture_opt.uncertainty.spread_function import covariance_c


@click.command("export")
@problem_options
@click.option("--to", "target", type=click.Choice(["c"]), required=True, help="c: C99 source and header, math.h alone.")
@click.option("--name", default="tool_covariance", show_default=True, help="Of the function and its files.")
@common_options
def command(common: Common, target: str, name: str, **given: Any) -> None:
    """Write position and covariance of the tool point, as functions of the joints, as C code."""
    problem = requested_problem(**given)
    with output(common), placed(problem):
        source, header = covariance_c(problem, name)
        files = {f"{name}.h": header, f"{name}.c": source}
        if common.out is not None:
            _write(common.out, files)

    def report() -> str:
        return "\n".join(files.values()) if common.out is None else f"written to {common.out}: {', '.join(files)}"

    show(common, lambda: {"target": target, "files": files}, report)


def _write(out: Path, files: dict[str, str]) -> None:
    with staged_folder(out, OUT) as folder:
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
