"""``optimize-posture map``: the best posture and its spread over a grid of targets."""

from __future__ import annotations

import re
from typing import Any

import click

import posture_opt as po
from posture_opt.cli.options import Common, common_options, problem_options, task_options
from posture_opt.cli.output import output_folder, progress_bar, show
from posture_opt.cli.request import corner, placed, requested_problem
from posture_opt.errors import InputError, Issue


@click.command("map")
@problem_options
@task_options
@click.option("--grid", metavar="NxM", help="Targets along the plane's sides, 15x15, or along x, y, z, 9x9x1.")
@click.option("--min", "low", metavar="TEXT", help='Lower corner of the box of targets: "0.3 m, -0.2 m, 0.1 m".')
@click.option("--max", "high", metavar="TEXT", help="Its upper corner.")
@click.option("--plane", type=click.Choice(["xy", "xz", "yz"]), help="Plane of the map; else across the direction.")
@common_options
def command(common: Common, grid: str | None, low: str | None, high: str | None, plane: Any, **given: Any) -> None:
    """The best posture and its spread over a grid of targets."""
    where = _where(grid, low, high)
    problem = requested_problem(**given)
    with output_folder(common.out) as folder, placed(problem):
        with progress_bar(common, "targets") as progress:
            found = po.map_targets(
                problem, **where, plane=plane, seed=common.seed, workers=common.workers, progress=progress
            )
        if folder is not None:
            from posture_opt.report.map_files import write_map

            write_map(folder, problem, found, common.plots)

    def text() -> str:
        from posture_opt.report.text import map_text

        return map_text(problem, found)

    show(common, found.to_json, text)


def _where(grid: str | None, low: str | None, high: str | None) -> dict[str, Any]:
    """Counts and corners as the options have them; everything wrong with them at once."""
    issues: list[Issue] = []
    where = {
        "counts": _counts(grid, issues),
        "low": corner("--min", low, issues),
        "high": corner("--max", high, issues),
    }
    if issues:
        raise InputError(issues)
    return where


def _counts(text: str | None, issues: list[Issue]) -> tuple[int, ...] | None:
    if text is None:
        return None
    parts = [part.strip() for part in re.split(r"[xX×*,]", text)]
    if not all(re.fullmatch(r"\d{1,6}", part) for part in parts):
        mend = "write for example 15x15, or 9x9x1 along x, y, z"
        issues.append(Issue(f"'{text}' is no grid", ("--grid",), text, mend))
        return None
    return tuple(map(int, parts))
