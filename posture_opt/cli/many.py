"""``optimize-posture batch``, ``compare`` and ``map``: many problems, several arms, a grid of targets."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.completion import PATH, PROBLEM
from posture_opt.cli.options import Common, common_options, problem_options, task_options
from posture_opt.cli.output import output, save_result, show_result
from posture_opt.cli.progress import print_rate, progress_bar
from posture_opt.cli.scheduler import checkpoint_option, digest_of, digest_of_file, scheduler_option, working
from posture_opt.errors import InputError, Issue
from posture_opt.files import is_there, preset_names

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem


@click.command("batch")
@click.argument("files", nargs=-1, required=True, type=PROBLEM, metavar="FILE…")
@scheduler_option
@checkpoint_option
@common_options
def batch_command(common: Common, files: Sequence[str], scheduler: str | None, checkpoint: Path | None) -> None:
    """Select postures for many problem files, in one report.

    If a file cannot be read or has no solution, its row says why, and the others are still solved. The exit code is
    the smallest one of these files: 2 (bad input) before 3 (no solution).
    """
    if len(set(files)) < len(files):
        twice = next(name for name in files if files.count(name) > 1)
        raise click.UsageError(f"{twice} is named twice: name different problem files.")
    problems: dict[str, Problem | InputError] = {}
    for name in files:
        try:
            problems[name] = po.load_problem(name)
        except InputError as error:
            problems[name] = error  # a row of the report says so
    read = {name: p for name, p in problems.items() if not isinstance(p, InputError)}
    pages = common.out is not None and common.plots
    digests = [[name, digest_of(problem)] for name, problem in read.items()]
    with output(common):
        work = working(common, scheduler, checkpoint, command="batch", seed=common.seed, pages=pages, problems=digests)
        with work as workers, progress_bar(common, "problems") as progress:
            found = po.select_postures(problems, seed=common.seed, pages=pages, executor=workers, progress=progress)
        save_result(common, found)
    show_result(common, found)
    if common.quiet and not common.json:
        failed = [answer for answer in found.answers if answer.code]
        for answer in failed[:20]:
            click.echo(f"error: {answer.name}: {'; '.join(answer.reasons)}", err=True)
        if len(failed) > 20:
            click.echo(f"error: {len(failed) - 20} more problems have no answer", err=True)
    print_rate(common, len(found.answers), "problem", found.seconds)
    sys.exit(found.code)


@click.command("compare")
@click.argument("problems", nargs=-1, required=True, type=PROBLEM, metavar="A.yaml B.yaml")
@task_options
@common_options
def compare_command(common: Common, problems: Sequence[str], **given: str | None) -> None:
    """Solve the task of the first problem file with the arm of each file.

    The files state different arms, or one arm before and after calibration. A preset stands for its arm. Options of the
    task hold for all. If the joints are the same, the report also predicts each posture's error with the other arms.
    """
    if len(problems) < 2:
        raise click.UsageError("Name two problem files, for example: compare before.yaml after.yaml")
    if len(set(problems)) < len(problems):
        raise click.UsageError(f"{problems[0]} is named twice: name two different problem files.")
    stems = [Path(name).stem for name in problems]
    labels = stems if len(set(stems)) == len(stems) else problems
    asked: dict[str, Problem] = {}
    for label, name in zip(labels, problems, strict=True):
        preset = name in preset_names() and not is_there(Path(name))
        file, robot = (None, name) if preset else (name, None)
        asked[label] = deferred.request.requested_problem(file, robot, **given)
    first = asked[labels[0]]
    with output(common):
        with progress_bar(common, "arms") as progress, deferred.request.placed(first):
            found = po.compare(asked, seed=common.seed, workers=common.workers, progress=progress)
        save_result(common, found)
    show_result(common, found)


@click.command("map")
@click.option(
    "--quantity", type=click.Choice(["spread", "accuracy"]), default="spread", show_default=True,
    help="Spread at the task, or mean error and spread of a calibrated arm.",
)  # fmt: skip
@click.option("--data", type=PATH, metavar="DATA.csv", help="Measurements to compare with the predicted accuracy.")
@click.option("--grid", metavar="NxM", help="Number of targets: 15x15 in the plane, or 9x9x1 along x, y, z.")
@click.option("--min", "low", metavar="TEXT", help='Lower corner of the box of targets: "0.3 m, -0.2 m, 0.1 m".')
@click.option("--max", "high", metavar="TEXT", help="Its upper corner.")
@click.option(
    "--plane", type=click.Choice(["xy", "xz", "yz"]), help="Plane of the map.  [default: across the direction]"
)
@problem_options
@task_options
@scheduler_option
@checkpoint_option
@common_options
def map_command(
    common: Common, quantity: str, data: Path | None, grid: str | None, low: str | None, high: str | None,
    plane: Literal["xy", "xz", "yz"] | None, scheduler: str | None, checkpoint: Path | None, **given: str | None,
) -> None:  # fmt: skip
    """Map the best posture and its spread, or the arm's accuracy, over a grid of targets."""
    if data is not None and quantity != "accuracy":
        raise click.UsageError("--data goes with --quantity accuracy.")
    where = {**_where(grid, low, high), "plane": plane, "seed": common.seed}
    problem = deferred.request.requested_problem(**given)
    with output(common), deferred.request.placed(problem):
        asked = {"problem": digest_of(problem), "quantity": quantity, "data": digest_of_file(data), **where}
        work = working(common, scheduler, checkpoint, command="map", **asked)
        measured = None if data is None else po.read_measurements(data, problem)
        with work as workers, progress_bar(common, "targets") as progress:
            found: po.TargetMap | po.AccuracyMap
            if quantity == "accuracy":
                found = po.map_accuracy(problem, measured, **where, executor=workers, progress=progress)
            else:
                found = po.map_targets(problem, **where, executor=workers, progress=progress)
        save_result(common, found)
    show_result(common, found)
    targets = found if isinstance(found, po.TargetMap) else found.targets
    print_rate(common, len(targets.map_points), "target", targets.seconds)


def _where(grid: str | None, low: str | None, high: str | None) -> dict[str, Any]:
    """Counts and corners [m] as the options state them; everything wrong with them at once."""
    issues: list[Issue] = []
    corners = [deferred.quantities.corner(*of, issues) for of in (("--min", low), ("--max", high))]
    parts = [] if grid is None else [part.strip() for part in re.split(r"[xX×*,]", grid)]
    if not all(re.fullmatch(r"\d{1,6}", part) for part in parts):
        hint = "write for example 15x15, or 9x9x1 along x, y, z"
        issues.insert(0, Issue(f"'{grid}' is no grid", ("--grid",), grid, hint))
    if issues:
        raise InputError(issues)
    return {"counts": None if grid is None else tuple(map(int, parts)), "low": corners[0], "high": corners[1]}
