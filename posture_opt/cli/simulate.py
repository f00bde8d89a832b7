"""``optimize-posture simulate``: the Monte Carlo cloud of the tool point beside the closed form."""

from __future__ import annotations

from typing import Any

import click

import posture_opt as po
from posture_opt.cli.options import Common, common_options, posture_option, problem_options
from posture_opt.cli.output import output, save_result, show_result
from posture_opt.cli.request import placed, requested_posture, requested_problem


@click.command("simulate")
@problem_options
@posture_option
@click.option(
    "-n", "--samples", "n", type=click.IntRange(min=2), default=5000, show_default=True, help="Samples to draw."
)
@click.option("--adaptive", is_flag=True, help="Draw until the standard deviations are stable in two digits.")
@common_options
def command(common: Common, posture: str, n: int, adaptive: bool, **given: Any) -> None:
    """Monte Carlo cloud of the tool point at one posture, beside the closed form."""
    problem = requested_problem(**given)
    values = requested_posture(posture, problem.robot)
    seed = problem.solver.seed if common.seed is None else common.seed
    with output(common), placed(problem):
        cloud = po.simulate(problem, values, n=n, seed=seed, adaptive=adaptive)
        save_result(common, cloud)
    show_result(common, cloud)
