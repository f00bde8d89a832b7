"""``optimize-posture diagnose``: what the simulation gets wrong, its cause by name, and what naming it brings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import posture_opt as po
from posture_opt.cli.options import Common, common_options, problem_options
from posture_opt.cli.output import output_folder, progress_bar, show
from posture_opt.cli.request import placed, requested_problem
from posture_opt.errors import InsufficientDataError


@click.command("diagnose")
@click.argument("data", type=click.Path(path_type=Path), metavar="DATA.csv")
@problem_options
@click.option("--test", type=click.Path(path_type=Path), metavar="OTHER.csv", help="Another session, to be predicted.")
@click.option("--refit-frames", is_flag=True, help="Fit base and tool again to the test file.")
@click.option(
    "--by",
    type=click.Choice(["pose", "block", "place"]),
    help="What the cross-validation leaves out together: a pose, a block of the workspace, a touched place.",
)
@click.option("--folds", type=click.IntRange(min=2), default=5, show_default=True, help="Of the cross-validation.")
@click.option("--with-time", is_flag=True, help="Keep effects of time in extended.yaml; the task's 'time' says when.")
@click.option("--no-plan", is_flag=True, help="Do not plan the task anew with the extended arm.")
@common_options
def command(
    common: Common, data: Path, test: Path | None, refit_frames: bool, by: Any, folds: int, with_time: bool,
    no_plan: bool, **given: Any,
) -> None:  # fmt: skip
    """What the simulation gets wrong, why, and how much better it is once the cause is part of the model."""
    if refit_frames and test is None:
        raise click.UsageError("--refit-frames goes with --test.")
    problem = requested_problem(**given)
    with output_folder(common.out) as folder, placed(problem):
        measured = po.read_measurements(data, problem)
        if len(measured.robot_names) > 1:
            if test is not None:
                raise click.UsageError("--test goes with measurements of one robot, and the data are of several.")
            from posture_opt.cli.diagnose_batch import diagnosed_batch

            show(common, *diagnosed_batch(common, folder, problem, measured, folds, by))
            return
        other = None if test is None else po.read_measurements(test, problem)
        try:
            with progress_bar(common, "diagnosing") as progress:
                found = po.diagnose(
                    problem, measured, folds=folds, by=by, seed=common.seed or 0, test=other,
                    refit_frames=refit_frames, with_time=with_time, progress=progress,
                )  # fmt: skip
        except InsufficientDataError as error:
            _tell_insufficient(common, error)
            raise
        from posture_opt.problem.extended import extended_problem, models_of, plan_again
        from posture_opt.problem.measured_goals import measured_goals
        from posture_opt.report.diagnosed import Diagnosed

        extended = extended_problem(problem, found)
        plans, goals = {}, None
        if problem.task is not None and not no_plan:
            models = models_of(problem, found, extended)
            plans, goals = plan_again(models, common.seed), measured_goals(found, models)
        diagnosed = Diagnosed(measured, found, folds, other, refit_frames, extended, plans, goals)
        if folder is not None:
            from posture_opt.report.write import write_diagnosis

            write_diagnosis(folder, problem, diagnosed, common.plots)

    def text() -> str:
        from posture_opt.report.text import diagnosis_text

        return diagnosis_text(problem, diagnosed)

    def document() -> dict[str, Any]:
        from posture_opt.report.write import diagnosis_document

        return diagnosis_document(diagnosed)

    show(common, document, text)


def _tell_insufficient(common: Common, error: InsufficientDataError) -> None:
    """The verdict on data that do not suffice is an answer too; what to measure stands in ``message``."""
    if common.json:
        document = {"verdict": "insufficient_data", "effects": [], "candidates": [], "message": str(error)}
        show(common, lambda: document, str)
