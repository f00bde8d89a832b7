"""Commands on one posture: the solve itself, ``uncertainty``, ``simulate`` and ``explore``."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.completion import PATH
from posture_opt.cli.options import Common, common_options, debug_option, posture_option, problem_options, task_options
from posture_opt.cli.output import output, progress_bar, save_result, show, show_result
from posture_opt.errors import NoSolutionError

if TYPE_CHECKING:
    pass


def solve(common: Common, explain: bool, **given: str | None) -> None:
    """Select the posture of the requested problem, write the files, print the report."""
    if given["robot"] and not given["task"]:
        raise click.UsageError("Name the --task of the robot, for example --task insert.")
    problem = deferred.request.requested_problem(**given)
    with output(common):
        reason = None
        with progress_bar(common, "searching") as progress, deferred.request.placed(problem):
            try:
                found = po.select_posture(problem, seed=common.seed, workers=common.workers, progress=progress)
            except NoSolutionError as error:
                if error.solution is None:
                    raise
                found, reason = error.solution, error  # the nearest posture, and what it violates
        save_result(common, found)
    show(common, found.to_json, lambda: found.report(full=common.full) + (f"\n{found.explain()}" if explain else ""))
    if reason is not None:
        reason.shown = True
        raise reason


@click.command("uncertainty")
@posture_option
@problem_options
@common_options
def uncertainty_command(common: Common, posture: str, **given: str | None) -> None:
    """Compute covariance, ellipse, coverage regions and error budget at one posture, in closed form."""
    problem = deferred.request.requested_problem(**given)
    values = deferred.quantities.requested_posture(posture, problem.robot)
    with output(common), deferred.request.placed(problem):
        with progress_bar(common, "computing"):
            spread = po.propagate(problem, values)
        save_result(common, spread)
    show_result(common, spread)


@click.command("simulate")
@posture_option
@click.option(
    "-n", "--samples", "n", type=click.IntRange(min=2), default=5000, show_default=True, help="Samples to draw."
)
@click.option("--adaptive", is_flag=True, help="Draw until the standard deviations are stable in two digits.")
@problem_options
@common_options
def simulate_command(common: Common, posture: str, n: int, adaptive: bool, **given: str | None) -> None:
    """Simulate the tool point at one posture (Monte Carlo) and compare it with the closed form."""
    problem = deferred.request.requested_problem(**given)
    values = deferred.quantities.requested_posture(posture, problem.robot)
    seed = problem.solver.seed if common.seed is None else common.seed
    with output(common), deferred.request.placed(problem):
        with progress_bar(common, "simulating"):
            cloud = po.simulate(problem, values, n=n, seed=seed, adaptive=adaptive)
        save_result(common, cloud)
    show_result(common, cloud)


@click.command("explore")
@click.argument("data", type=PATH, metavar="[DATA.csv]", required=False)
@click.option(
    "--host", default="127.0.0.1", show_default=True,
    help="Address to serve; 0.0.0.0 serves other machines too, with a token.",
)  # fmt: skip
@click.option(
    "--port", type=click.IntRange(1, 65535), default=8080, show_default=True, help="Port, or the next one that is free."
)
@click.option("--no-browser", is_flag=True, help="Open no browser.")
@problem_options
@task_options
@debug_option
def explore_command(data: Path | None, host: str, port: int, no_browser: bool, **given: str | None) -> None:
    """Drag the target on a live page; the best posture follows. Ctrl-C ends it.

    The page shows the errors of the measurements in DATA.csv. --problem may be the folder of a diagnosis or
    calibration.
    """
    problem = deferred.request.requested_problem(**given)
    with deferred.request.placed(problem):
        measured = None if data is None else po.read_measurements(data, problem)
        page = import_module("posture_opt.explore.explorer").Explorer(problem, host, port, data=measured)
    with page:
        click.echo(f"Listening on {page.url}")
        if page.reach:
            click.echo(page.reach, err=True)
        if not no_browser:
            import_module("webbrowser").open_new_tab(page.url)
        page.wait()
