"""Commands on one posture: the solve itself, ``uncertainty`` and ``simulate``.

Each reads a problem and a posture, computes, saves into ``--out`` and prints one report.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.asked.options import Common, common_options, posture_option, problem_options
from posture_opt.cli.output import output, save_result, show, show_result
from posture_opt.cli.progress import progress_bar
from posture_opt.errors import NoSolutionError

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem


def solve(common: Common, explain: bool, **given: str | None) -> None:
    """Select the posture of the requested problem, write the files, print the report.

    A problem without a solution has files and a report too: the nearest posture, and what it violates. The error is
    raised after both are written.

    Args:
        explain: print the optimisation problem with its values at the solution.
        given: the options of problem, robot and task, by their names.

    Raises:
        NoSolutionError: no posture meets all requirements; exit code 3.
        InputError: the options or the file do not fit.
    """
    if given["robot"] and not given["task"]:
        raise click.UsageError("Name the --task of the robot, for example --task insert.")
    problem = deferred.requested_problem(**given)
    with output(common):
        solution, reason = _solved(problem, common)
        save_result(common, solution)
    show(common, solution.to_json, lambda: _text(solution, explain, common.full))
    if reason is not None:
        raise reason


def _solved(problem: Problem, common: Common) -> tuple[po.Solution, NoSolutionError | None]:
    """The solution, or the nearest posture with the reason why it is none."""
    with progress_bar(common, "searching") as progress, deferred.placed(problem):
        try:
            return po.select_posture(problem, seed=common.seed, workers=common.workers, progress=progress), None
        except NoSolutionError as error:
            if error.solution is None:
                raise
            return error.solution, error


def _text(solution: po.Solution, explain: bool, full: bool) -> str:
    """The report, with the optimisation problem behind it where that is asked for."""
    text = solution.report(full=full)
    return f"{text}\n{solution.explain()}" if explain else text


@click.command("uncertainty")
@problem_options
@posture_option
@common_options
def uncertainty_command(common: Common, posture: str, **given: str | None) -> None:
    """Covariance, ellipse, coverage regions and error budget at one posture, in closed form."""
    problem = deferred.requested_problem(**given)
    values = deferred.requested_posture(posture, problem.robot)
    with output(common), deferred.placed(problem):
        with progress_bar(common, "computing"):
            spread = po.propagate(problem, values)
        save_result(common, spread)
    show_result(common, spread)


@click.command("simulate")
@problem_options
@posture_option
@click.option(
    "-n", "--samples", "n", type=click.IntRange(min=2), default=5000, show_default=True, help="Samples to draw."
)
@click.option("--adaptive", is_flag=True, help="Draw until the standard deviations are stable in two digits.")
@common_options
def simulate_command(common: Common, posture: str, n: int, adaptive: bool, **given: str | None) -> None:
    """Monte Carlo cloud of the tool point at one posture, beside the closed form."""
    problem = deferred.requested_problem(**given)
    values = deferred.requested_posture(posture, problem.robot)
    seed = problem.solver.seed if common.seed is None else common.seed
    with output(common), deferred.placed(problem):
        with progress_bar(common, "simulating"):
            cloud = po.simulate(problem, values, n=n, seed=seed, adaptive=adaptive)
        save_result(common, cloud)
    show_result(common, cloud)
