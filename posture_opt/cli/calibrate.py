"""``optimize-posture calibrate``: the parameters of the arm from measurements, and what they bring."""

from __future__ import annotations

from functools import partial
from typing import Any

import click

import posture_opt as po
from posture_opt.cli.measured import Session, answer, measured_options
from posture_opt.cli.options import Common, common_options
from posture_opt.cli.output import progress_bar
from posture_opt.result import Result


@click.command("calibrate")
@measured_options
@click.option("--no-priors", is_flag=True, help="Let the σ's of the problem file not count as knowledge.")
@common_options
def command(common: Common, session: Session, no_priors: bool, **given: Any) -> None:
    """What the simulation gets wrong, and the parameters of the arm that the measurements determine."""

    of_one = partial(_calibrated, common, session, not no_priors)
    answer(common, session, given, of_one, partial(_calibrated_batch, common, session))


def _calibrated_batch(common: Common, session: Session, problem: Any, data: po.Measurements) -> Result:
    with progress_bar(common, "calibrating robots") as progress:
        return po.calibrate_batch(problem, data, folds=session.folds, by=session.by, progress=progress)


def _calibrated(
    common: Common,
    session: Session,
    priors: bool,
    problem: Any,
    measured: po.Measurements,
    other: po.Measurements | None,
) -> Result:
    with progress_bar(common, "calibrating") as progress:
        return po.calibrate(
            problem, measured, priors=priors, folds=session.folds, by=session.by, test=other,
            refit_frames=session.refit_frames, plan=session.plan, seed=common.seed, progress=progress,
        )  # fmt: skip
