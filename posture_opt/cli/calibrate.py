"""``optimize-posture calibrate``: the parameters of the arm from measurements, and what they bring."""

from __future__ import annotations

from functools import partial
from typing import Any

import click

import posture_opt as po
from posture_opt.cli.measured import Session, answer, measured_options
from posture_opt.cli.options import Common, common_options
from posture_opt.cli.output import Answer, progress_bar, save_result
from posture_opt.report.calibration_report import (
    Learned,
    calibration_document,
    calibration_report,
    save_calibration,
)
from posture_opt.report.text import render
from posture_opt.validation.calibrated_arm import calibrated_models, compare_models


@click.command("calibrate")
@measured_options
@click.option("--no-priors", is_flag=True, help="Let the σ's of the problem file not count as knowledge.")
@common_options
def command(common: Common, session: Session, no_priors: bool, **given: Any) -> None:
    """What the simulation gets wrong, and the parameters of the arm that the measurements determine."""

    of_one = partial(_calibrated, common, session, not no_priors)
    answer(common, session, given, of_one, partial(_calibrated_batch, common, session))


def _calibrated_batch(common: Common, session: Session, problem: Any, data: po.Measurements) -> Answer:
    """Calibrates every robot, and saves what the batch says."""
    with progress_bar(common, "calibrating robots") as progress:
        found = po.calibrate_batch(problem, data, folds=session.folds, by=session.by, progress=progress)
    save_result(common, found)
    return found.to_json, found.report


def _calibrated(
    common: Common,
    session: Session,
    priors: bool,
    problem: Any,
    measured: po.Measurements,
    other: po.Measurements | None,
) -> Answer:
    """Calibrates one robot, writes the files, and returns what can be shown."""
    folds, again = session.folds, session.refit_frames
    with progress_bar(common, "calibrating") as progress:
        found = po.calibrate(
            problem, measured, priors=priors, folds=folds, by=session.by, test=other, refit_frames=again,
            progress=progress,
        )  # fmt: skip
    models = calibrated_models(problem, found)
    learned = Learned(
        measured, found, folds, priors, other, again,
        calibrated=models["calibrated"],
        assessment=po.assess(problem, measured, found),
        spread_check=po.check_spread(problem, measured, found, folds=folds),
        comparison=compare_models(problem.robot, models, seed=common.seed) if session.plan else None,
    )  # fmt: skip
    if common.out is not None:
        save_calibration(common.out, problem, learned, common.plots)
    return partial(calibration_document, learned), lambda: render(calibration_report(problem, learned))
