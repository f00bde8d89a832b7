"""``optimize-posture map``: the best posture and its spread, or the arm's accuracy, over a grid of targets.

A checkpoint belongs to one request: problem, quantity, data, grid and seed.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.asked.named_values import PATH
from posture_opt.cli.asked.options import Common, common_options, problem_options, task_options
from posture_opt.cli.output import output, save_result, show_result
from posture_opt.cli.progress import print_rate, progress_bar
from posture_opt.cli.scheduler import checkpoint_option, digest_of, digest_of_file, scheduler_option, working
from posture_opt.errors import InputError, Issue

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem


@click.command("map")
@problem_options
@task_options
@click.option(
    "--quantity",
    type=click.Choice(["spread", "accuracy"]),
    default="spread",
    show_default=True,
    help="The task's spread, or mean error and spread of the arm with the corrections of a calibration.",
)
@click.option(
    "--data",
    type=PATH,
    metavar="DATA.csv",
    help="Measurements to compare with the predicted accuracy.",
)
@click.option("--grid", metavar="NxM", help="Targets along the plane's sides, 15x15, or along x, y, z, 9x9x1.")
@click.option("--min", "low", metavar="TEXT", help='Lower corner of the box of targets: "0.3 m, -0.2 m, 0.1 m".')
@click.option("--max", "high", metavar="TEXT", help="Its upper corner.")
@click.option("--plane", type=click.Choice(["xy", "xz", "yz"]), help="Plane of the map; else across the direction.")
@scheduler_option
@checkpoint_option
@common_options
def map_command(
    common: Common, quantity: str, data: Path | None, grid: str | None, low: str | None, high: str | None,
    plane: Literal["xy", "xz", "yz"] | None, scheduler: str | None, checkpoint: Path | None, **given: str | None,
) -> None:  # fmt: skip
    """The best posture and its spread, or the arm's accuracy, over a grid of targets."""
    if data is not None and quantity != "accuracy":
        raise click.UsageError("--data goes with --quantity accuracy.")
    where = {**_where(grid, low, high), "plane": plane, "seed": common.seed}
    problem = deferred.requested_problem(**given)
    with output(common), deferred.placed(problem):
        asked = {"problem": digest_of(problem), "quantity": quantity, "data": digest_of_file(data), **where}
        with working(common, scheduler, checkpoint, command="map", **asked) as workers:
            found = _mapped(problem, quantity, data, common, {**where, "executor": workers})
        save_result(common, found)
    show_result(common, found)
    targets = found if isinstance(found, po.TargetMap) else found.targets
    print_rate(common, len(targets.map_points), "target", targets.seconds)


def _mapped(
    problem: Problem, quantity: str, data: Path | None, common: Common, where: dict[str, Any]
) -> po.TargetMap | po.AccuracyMap:
    """The map that is asked for: of the task's spread, or of the arm's accuracy.

    Args:
        quantity: ``spread`` or ``accuracy``; ``data`` measurements to compare the latter with.
        where: counts, corners [m], plane, seed and executor, as `map_targets` takes them.
    """
    measured = None if data is None else po.read_measurements(data, problem)
    with progress_bar(common, "targets") as progress:
        if quantity == "accuracy":
            return po.map_accuracy(problem, measured, **where, progress=progress)
        return po.map_targets(problem, **where, progress=progress)


def _where(grid: str | None, low: str | None, high: str | None) -> dict[str, Any]:
    """Counts and corners [m] as the options state them; everything wrong with them at once.

    Raises:
        InputError: no grid, or corners without three lengths.
    """
    issues: list[Issue] = []
    where = {
        "counts": _counts(grid, issues),
        "low": deferred.corner("--min", low, issues),
        "high": deferred.corner("--max", high, issues),
    }
    if issues:
        raise InputError(issues)
    return where


def _counts(text: str | None, issues: list[Issue]) -> tuple[int, ...] | None:
    """The targets along each side of ``15x15``; what is wrong with it is added to ``issues``.

    ``x``, ``X``, ``×``, ``*`` and commas separate the numbers; whether they make a grid is checked later.
    """
    if text is None:
        return None
    parts = [part.strip() for part in re.split(r"[xX×*,]", text)]
    if not all(re.fullmatch(r"\d{1,6}", part) for part in parts):
        hint = "write for example 15x15, or 9x9x1 along x, y, z"
        issues.append(Issue(f"'{text}' is no grid", ("--grid",), text, hint))
        return None
    return tuple(map(int, parts))
