"""``optimize-posture diagnose``: what the simulation gets wrong, its cause by name, and what naming it brings."""

from __future__ import annotations

from functools import partial
from typing import Any

import click

import posture_opt as po
from posture_opt.cli.measured import Session, answer, measured_options
from posture_opt.cli.options import Common, common_options
from posture_opt.cli.output import progress_bar, show
from posture_opt.errors import InsufficientDataError
from posture_opt.result import Result


@click.command("diagnose")
@measured_options
@click.option("--with-time", is_flag=True, help="Keep effects of time in extended.yaml; the task's 'time' says when.")
@common_options
def command(common: Common, session: Session, with_time: bool, **given: Any) -> None:
    """What the simulation gets wrong, why, and how much better it is once the cause is part of the model."""

    of_one = partial(_diagnosed, common, session, with_time)
    answer(common, session, given, of_one, partial(_diagnosed_batch, common, session))


def _diagnosed_batch(common: Common, session: Session, problem: Any, data: po.Measurements) -> Result:
    with progress_bar(common, "diagnosing robots") as progress:
        return po.diagnose_batch(
            problem, data, folds=session.folds, by=session.by, seed=common.seed or 0, progress=progress
        )


def _diagnosed(
    common: Common,
    session: Session,
    with_time: bool,
    problem: Any,
    measured: po.Measurements,
    other: po.Measurements | None,
) -> Result:
    try:
        with progress_bar(common, "diagnosing") as progress:
            return po.diagnose(
                problem, measured, folds=session.folds, by=session.by, seed=common.seed, test=other,
                refit_frames=session.refit_frames, with_time=with_time, plan=session.plan, progress=progress,
            )  # fmt: skip
    except InsufficientDataError as error:
        _tell_insufficient(common, error)
        raise


def _tell_insufficient(common: Common, error: InsufficientDataError) -> None:
    """The verdict on data that do not suffice is an answer too; what to measure stands in ``message``."""
    if common.json:
        document = {"verdict": "insufficient_data", "effects": [], "candidates": [], "message": str(error)}
        show(common, lambda: document, str)
