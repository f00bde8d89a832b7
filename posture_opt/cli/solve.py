"""The solve itself: ``optimize-posture --task insert``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

import posture_opt as po
from posture_opt.cli.options import Common
from posture_opt.cli.output import output_folder, progress_bar, rendered, show
from posture_opt.cli.request import placed, requested_problem
from posture_opt.errors import NoSolutionError
from posture_opt.problem.problem import Problem

if TYPE_CHECKING:
    from posture_opt.selection.solution import Solution


def solve(common: Common, explain: bool, **given: Any) -> None:
    """Select the posture of the requested problem, write the files, print the report.

    A problem without a solution has files and a report too: the nearest posture, and what it violates.
    """
    if given["robot"] and not given["task"]:
        raise click.UsageError("Name the --task of the robot, for example --task insert.")
    problem = requested_problem(**given)
    with output_folder(common.out) as folder:
        solution, reason = _solved(problem, common)
        if folder is not None:
            from posture_opt.report.write import write_solution

            write_solution(folder, problem, solution, plots=common.plots)
    show(common, solution.to_json, lambda: _text(problem, solution, explain))
    if reason is not None:
        raise reason


def _solved(problem: Problem, common: Common) -> tuple[Solution, NoSolutionError | None]:
    """The solution, or the nearest posture with the reason why it is none."""
    with progress_bar(common, "starts") as progress, placed(problem):
        try:
            return po.select_posture(problem, seed=common.seed, workers=common.workers, progress=progress), None
        except NoSolutionError as error:
            if error.solution is None:
                raise
            return error.solution, error


def _text(problem: Problem, solution: Solution, explain: bool) -> str:
    report = rendered("solution_report", problem, solution)()
    return f"{report.rstrip()}\n\n{rendered('explain_report', problem, solution)()}" if explain else report
