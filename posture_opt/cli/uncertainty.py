"""``optimize-posture uncertainty``: the spread of the tool point at one posture, in closed form."""

from __future__ import annotations

from typing import Any

import click

import posture_opt as po
from posture_opt.cli.options import Common, common_options, posture_option, problem_options
from posture_opt.cli.output import output, save_result, show_result
from posture_opt.cli.request import placed, requested_posture, requested_problem


@click.command("uncertainty")
@problem_options
@posture_option
@common_options
def command(common: Common, posture: str, **given: Any) -> None:
    """Covariance, ellipse, coverage regions and error budget at one posture, in closed form."""
    problem = requested_problem(**given)
    values = requested_posture(posture, problem.robot)
    with output(common), placed(problem):
        spread = po.propagate(problem, values)
        save_result(common, spread)
    show_result(common, spread)
