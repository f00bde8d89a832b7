"""``optimize-posture diagnose``: what the simulation gets wrong, its cause by name, and what naming it brings."""

from __future__ import annotations

from functools import partial
from typing import Any

import click

import posture_opt as po
from posture_opt.cli.measured import Session, answer, measured_options
from posture_opt.cli.options import Common, common_options
from posture_opt.cli.output import Answer, progress_bar, save_result, show
from posture_opt.diagnosis.measured_goals import measured_goals
from posture_opt.errors import InsufficientDataError
from posture_opt.report.diagnosed import Diagnosed
from posture_opt.report.diagnosis_report import diagnosis_document, diagnosis_report, save_diagnosis
from posture_opt.report.text import render
from posture_opt.validation.calibrated_arm import compare_models


@click.command("diagnose")
@measured_options
@click.option("--with-time", is_flag=True, help="Keep effects of time in extended.yaml; the task's 'time' says when.")
@common_options
def command(common: Common, session: Session, with_time: bool, **given: Any) -> None:
    """What the simulation gets wrong, why, and how much better it is once the cause is part of the model."""

    of_one = partial(_diagnosed, common, session, with_time)
    answer(common, session, given, of_one, partial(_diagnosed_batch, common, session))


def _diagnosed_batch(common: Common, session: Session, problem: Any, data: po.Measurements) -> Answer:
    """Diagnoses the batch, and saves what it says."""
    with progress_bar(common, "diagnosing robots") as progress:
        found = po.diagnose_batch(
            problem, data, folds=session.folds, by=session.by, seed=common.seed or 0, progress=progress
        )
    save_result(common, found)
    return found.to_json, found.report


def _diagnosed(
    common: Common,
    session: Session,
    with_time: bool,
    problem: Any,
    measured: po.Measurements,
    other: po.Measurements | None,
) -> Answer:
    """Diagnoses one robot, plans again, writes the files, and returns what can be shown."""
    try:
        with progress_bar(common, "diagnosing") as progress:
            found = po.diagnose(
                problem, measured, folds=session.folds, by=session.by, seed=common.seed or 0, test=other,
                refit_frames=session.refit_frames, with_time=with_time, progress=progress,
            )  # fmt: skip
    except InsufficientDataError as error:
        _tell_insufficient(common, error)
        raise
    comparison, goals = None, None
    if problem.task is not None and session.plan:
        comparison = compare_models(problem.robot, found.models, seed=common.seed)
        goals = measured_goals(found, found.models)
    frames = session.refit_frames
    diagnosed = Diagnosed(measured, found, session.folds, other, frames, found.extended, comparison, goals, problem)
    if common.out is not None:
        save_diagnosis(common.out, problem, diagnosed, common.plots)
    return partial(diagnosis_document, diagnosed), lambda: render(diagnosis_report(problem, diagnosed))


def _tell_insufficient(common: Common, error: InsufficientDataError) -> None:
    """The verdict on data that do not suffice is an answer too; what to measure stands in ``message``."""
    if common.json:
        document = {"verdict": "insufficient_data", "effects": [], "candidates": [], "message": str(error)}
        show(common, lambda: document, str)
