"""``optimize-posture calibrate`` and ``diagnose``: what measurements of one robot, or of several, say.

Data with a column of robots go to the functions for a batch, all others to those for one robot. Without a problem file
one is made for the data, with base and tool free, and written for editing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.asked.named_values import PATH
from posture_opt.cli.asked.options import Command, Common, add_options, common_options, problem_options
from posture_opt.cli.output import output, save_result, show_result, write_text
from posture_opt.cli.progress import progress_bar
from posture_opt.errors import InputError, InsufficientDataError, Issue
from posture_opt.files import content, is_file

if TYPE_CHECKING:
    from posture_opt.calibration.estimation.error_statistics import By
    from posture_opt.problem.problem import Problem
    from posture_opt.result import Result

OfOne: TypeAlias = "Callable[[Problem, po.Measurements, po.Measurements | None], Result]"
"""Problem, measurements and test file of one robot -> the result."""
OfBatch: TypeAlias = "Callable[[Problem, po.Measurements], Result]"


@dataclass(frozen=True)
class Session:
    """The measurements that are asked about, and how errors are predicted.

    Args:
        data: of the robot; ``test`` those of another session, predicted and not fitted.
        refit_frames: whether base and tool are fitted to the test file again.
        by: what cross-validation holds out together, in ``folds`` parts.
        plan: whether the task is planned again with the identified arm.
        columns: known name -> column header or number of a foreign file.
    """

    data: Path
    test: Path | None
    refit_frames: bool
    by: By | None
    folds: int
    plan: bool
    columns: Mapping[str, str | int]
    most_rows: Mapping[str, int]
    """``most_rows``, where it was stated."""


def measured_options(command: Command) -> Command:
    """Adds the argument DATA.csv and what goes with it, which the command gets as ``session``."""

    @wraps(command)
    def with_session(*args: Any, data: Path, test: Path | None, refit_frames: bool, **others: Any) -> Any:
        by, folds, plan = others.pop("by"), others.pop("folds"), not others.pop("no_plan")
        named, rows = deferred.columns_of(others.pop("column")), others.pop("rows")
        most = {} if rows is None else {"most_rows": rows}
        return command(*args, session=Session(data, test, refit_frames, by, folds, plan, named, most), **others)

    own = add_options(
        with_session,
        click.argument("data", type=PATH, metavar="DATA.csv"),
        click.option(
            "--test",
            type=PATH,
            metavar="OTHER.csv",
            help="Measurements of another session, used as a test set.",
        ),
        click.option("--refit-frames", is_flag=True, help="Refit base and tool to the test file."),
        click.option(
            "--by",
            type=click.Choice(["pose", "block", "place", "stretch"]),
            help="What cross-validation holds out together: a pose, a block of the workspace, a touched point, a "
            "stretch of a path.",
        ),
        click.option(
            "--folds", type=click.IntRange(min=2), default=5, show_default=True, help="Of the cross-validation."
        ),
        click.option(
            "--column",
            "column",
            metavar="NAME=HEAD",
            multiple=True,
            help='What a column of a foreign file is: --column "x=Pos X [mm]", or its number: x=7.',
        ),
        click.option(
            "--rows",
            type=click.IntRange(min=1),
            help="Thin larger files evenly to so many rows; the others judge the result.  "
            "[default: 100000 to calibrate, 4000 to diagnose]",
        ),
        click.option("--no-plan", is_flag=True, help="Do not re-plan the task with the identified arm."),
    )
    return problem_options(own)


def answer(common: Common, session: Session, given: dict[str, str | None], of_one: OfOne, of_batch: OfBatch) -> None:
    """Reads the measurements and shows what they say, those of one robot or those of several.

    Args:
        given: the options that name problem and robot, by their names.
        of_one: what is computed for one robot; ``of_batch`` for several.

    Raises:
        UsageError: ``--refit-frames`` without a test file, or a test file with several robots.
    """
    if session.refit_frames and session.test is None:
        raise click.UsageError("--refit-frames goes with --test.")
    made = given["problem"] is None and given["robot"] is not None and not deferred.names_problem_file(given["robot"])
    if made:
        problem = deferred.problem_of_data(session.data, columns=session.columns, **_without_problem(given))
    else:
        problem = deferred.with_columns(deferred.requested_problem(**given), session.columns)
    starter = StarterFile.of(common, session.data, problem) if made else StarterFile()
    with output(common), deferred.placed(problem):
        measured = _read(common, session.data, problem)
        if len(measured.robot_names) > 1:
            if session.test is not None:
                raise click.UsageError("--test goes with measurements of one robot, and the data are of several.")
            found = of_batch(problem, measured)
        else:
            other = None if session.test is None else _read(common, session.test, problem)
            found = of_one(problem, measured, other)
        save_result(common, found, starter.beside)
        show_result(common, found)  # what the report is held against is computed here
        starter.write(common)


def _read(common: Common, path: Path, problem: po.Problem) -> po.Measurements:
    """The measurements of a file; very many rows take a while."""
    with progress_bar(common, f"reading {path.name}"):
        return po.read_measurements(path, problem)


def _without_problem(given: dict[str, str | None]) -> dict[str, Any]:
    """The options but ``--problem``."""
    return {key: value for key, value in given.items() if key != "problem"}


@dataclass(frozen=True)
class StarterFile:
    """The problem file that was made for measurements without one.

    Args:
        beside: by file name, with the results in ``--out``.
        alone: its path in the working folder, where no folder is given; written where the report is printed.
        text: of that file.
    """

    beside: Mapping[str, bytes] = field(default_factory=dict)
    alone: Path | None = None
    text: str = ""

    @classmethod
    def of(cls, common: Common, data: Path, problem: Problem) -> StarterFile:
        """The file, not written yet.

        Raises:
            InputError: the folder for results has another one, which somebody may have edited.
        """
        if common.out is None:
            return cls(alone=Path(f"{data.stem}_problem.yaml"), text=problem.to_yaml())
        files = problem.files("problem")
        for name, made in files.items():
            there = common.out / name
            if is_file(there) and content(there, deferred.MAX_BYTES) != made:
                hint = f"name it with --problem {there} in place of --robot, or choose another folder"
                raise InputError(Issue(f"{there} exists and says something else", ("--out",), str(common.out), hint))
        return cls(files)

    def write(self, common: Common) -> None:
        """Writes the file to the working folder, unless there is one, and says so.

        A file that exists and differs is left as it is: somebody may have edited it.
        """
        if self.alone is None or common.json or common.quiet:
            return
        if not self.alone.exists():
            write_text(self.alone, self.text)
            click.echo(f"{self.alone} is the problem file of this call: edit it, and name it with --problem.")
        elif content(self.alone, deferred.MAX_BYTES) != self.text.encode():
            click.echo(f"{self.alone} exists and was left as it is: it is used with --problem {self.alone}.")


@click.command("calibrate")
@measured_options
@click.option("--no-priors", is_flag=True, help="Do not use the σ's of the problem file as priors.")
@common_options
def calibrate_command(common: Common, session: Session, no_priors: bool, **given: str | None) -> None:
    """What the simulation gets wrong, and the parameters of the arm that the measurements determine."""

    of_one = partial(_calibrated, common, session, not no_priors)
    answer(common, session, given, of_one, partial(_calibrated_batch, common, session))


def _calibrated_batch(common: Common, session: Session, problem: po.Problem, data: po.Measurements) -> Result:
    """Calibrate several robots of one type with a progress bar, one step a robot."""
    with progress_bar(common, "calibrating robots") as progress:
        return po.calibrate_batch(
            problem, data, folds=session.folds, by=session.by, progress=progress, **session.most_rows
        )


def _calibrated(
    common: Common,
    session: Session,
    priors: bool,
    problem: po.Problem,
    measured: po.Measurements,
    other: po.Measurements | None,
) -> Result:
    """Calibrate one robot with a progress bar."""
    with progress_bar(common, "calibrating") as progress:
        return po.calibrate(
            problem, measured, priors=priors, folds=session.folds, by=session.by, test=other,
            refit_frames=session.refit_frames, plan=session.plan, seed=common.seed, progress=progress,
            **session.most_rows,
        )  # fmt: skip


@click.command("diagnose")
@measured_options
@click.option("--with-time", is_flag=True, help="Keep effects of time in extended.yaml; the task's 'time' says when.")
@common_options
def diagnose_command(common: Common, session: Session, with_time: bool, **given: str | None) -> None:
    """What the simulation gets wrong, why, and how much better it is once the cause is part of the model."""

    of_one = partial(_diagnosed, common, session, with_time)
    answer(common, session, given, of_one, partial(_diagnosed_batch, common, session))


def _diagnosed_batch(common: Common, session: Session, problem: po.Problem, data: po.Measurements) -> Result:
    """Diagnose several robots of one type with a progress bar."""
    with progress_bar(common, "diagnosing robots") as progress:
        return po.diagnose_batch(
            problem, data, folds=session.folds, by=session.by, seed=common.seed, progress=progress,
            **session.most_rows,
        )  # fmt: skip


def _diagnosed(
    common: Common,
    session: Session,
    with_time: bool,
    problem: po.Problem,
    measured: po.Measurements,
    other: po.Measurements | None,
) -> Result:
    """Diagnose one robot with a progress bar; data that do not suffice are reported as a verdict, too.

    Raises:
        InsufficientDataError: what to measure is in its message.
    """
    try:
        with progress_bar(common, "diagnosing") as progress:
            return po.diagnose(
                problem, measured, folds=session.folds, by=session.by, seed=common.seed, test=other,
                refit_frames=session.refit_frames, with_time=with_time, plan=session.plan, progress=progress,
                **session.most_rows,
            )  # fmt: skip
    except InsufficientDataError as error:
        error.answer = {"verdict": "insufficient_data", "effects": [], "candidates": [], "message": str(error)}
        raise
