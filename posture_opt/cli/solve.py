"""The solve itself: ``optimize-posture --task insert``."""

from __future__ import annotations

from typing import Any

import click

import posture_opt as po
from posture_opt.cli.options import Common
from posture_opt.cli.output import output, progress_bar, save_result, show
from posture_opt.cli.request import placed, requested_problem
from posture_opt.errors import NoSolutionError
from posture_opt.problem.problem import Problem


def solve(common: Common, explain: bool, **given: Any) -> None:
    """Select the posture of the requested problem, write the files, print the report.

    A problem without a solution has files and a report too: the nearest posture, and what it violates.
    """
    if given["robot"] and not given["task"]:
        raise click.UsageError("Name the --task of the robot, for example --task insert.")
    problem = requested_problem(**given)
    with output(common):
        solution, reason = _solved(problem, common)
        save_result(common, solution)
    show(common, solution.to_json, lambda: _text(solution, explain))
    if reason is not None:
        raise reason


def _solved(problem: Problem, common: Common) -> tuple[po.Solution, NoSolutionError | None]:
    """The solution, or the nearest posture with the reason why it is none."""
    with progress_bar(common, "starts") as progress, placed(problem):
        try:
            return po.select_posture(problem, seed=common.seed, workers=common.workers, progress=progress), None
        except NoSolutionError as error:
            if error.solution is None:
                raise
            return error.solution, error


def _text(solution: po.Solution, explain: bool) -> str:
    return f"{solution.report()}\n{solution.explain()}" if explain else solution.report()
