"""``optimize-posture calibrate``, ``diagnose`` and ``recheck``: what measurements of robots say.

Without a problem file one is made for the data, with base and tool free, and written for editing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.completion import PATH
from posture_opt.cli.options import Command, Common, add_options, common_options, problem_options
from posture_opt.cli.output import OUT, output, save_result, show_result, write_text
from posture_opt.cli.progress import progress_bar
from posture_opt.errors import InputError, InsufficientDataError, Issue
from posture_opt.files import content, is_file
from posture_opt.limits import MAX_YAML_BYTES
from posture_opt.output import write_file

if TYPE_CHECKING:
    from posture_opt.result import Result


@dataclass(frozen=True)
class Session:
    """The files of measurements, column -> header or number of a foreign file, and keywords of what is computed.

    ``of_one`` are those for one robot, ``of_any`` those for one or several.
    """

    data: Path
    test: Path | None
    columns: Mapping[str, str | int]
    of_one: Mapping[str, Any]
    of_any: Mapping[str, Any]


def measured_options(command: Command) -> Command:
    """Add the argument DATA.csv and what goes with it, which the command gets as ``session``."""

    @wraps(command)
    def with_session(
        *args: Any, data: Path, test: Path | None, refit_frames: bool, by: str | None, folds: int, no_plan: bool,
        column: tuple[str, ...], rows: int | None, **others: Any,
    ) -> Any:  # fmt: skip
        if refit_frames and test is None:
            raise click.UsageError("--refit-frames goes with --test.")
        of_any = {"folds": folds, "by": by, **({} if rows is None else {"most_rows": rows})}
        of_one = {"refit_frames": refit_frames, "plan": not no_plan}
        session = Session(data, test, deferred.quantities.columns_of(column), of_one, of_any)
        return command(*args, session=session, **others)

    return add_options(
        with_session,
        click.argument("data", type=PATH, metavar="DATA.csv"),
        click.option("--test", type=PATH, metavar="OTHER.csv",
                     help="Measurements of another session, used as a test set."),
        click.option("--refit-frames", is_flag=True, help="Refit base and tool to the test file."),
        click.option("--by", type=click.Choice(["pose", "block", "place", "stretch"]),
                     help="Held out together in cross-validation: a pose, a block of the workspace, a touched "
                     "point, a stretch of a path."),
        click.option("--folds", type=click.IntRange(min=2), default=5, show_default=True,
                     help="Folds of the cross-validation."),
        click.option("--column", "column", metavar="NAME=HEADER", multiple=True,
                     help='Map a column by header, --column "x=Pos X [mm]", or by number, --column x=7.'),
        click.option("--rows", type=click.IntRange(min=1),
                     help="Thin larger files evenly to this many rows; the others test the result.  "
                     "[default: 100000 to calibrate, 4000 to diagnose]"),
        click.option("--no-plan", is_flag=True, help="Do not re-plan the task with the identified arm."),
    )  # fmt: skip


def answer(
    common: Common, session: Session, given: dict[str, str | None], doing: str,
    one: Callable[..., Result], several: Callable[..., Result],
) -> None:  # fmt: skip
    """Read the measurements and show what they say: of one robot by ``one(problem, data, …)``, or of ``several``."""
    robot, request = given["robot"], deferred.request
    made = given["problem"] is None and robot is not None and not request.names_problem_file(robot)
    if made:
        of_robot = {key: value for key, value in given.items() if key != "problem"}
        problem = request.problem_of_data(session.data, columns=session.columns, **of_robot)
    else:
        problem = request.with_columns(request.requested_problem(**given), session.columns)
    beside = _starter_files(common.out, problem) if made and common.out is not None else {}
    with output(common), request.placed(problem):
        measured, keywords = _read(common, session.data, problem), {**session.of_any}
        many = len(measured.robot_names) > 1
        if many and session.test is not None:
            raise click.UsageError("--test goes with measurements of one robot, and the data are of several.")
        if not many:
            other = None if session.test is None else _read(common, session.test, problem)
            keywords |= {"test": other, "seed": common.seed, **session.of_one}
        with progress_bar(common, f"{doing} robots" if many else doing) as progress:
            found = (several if many else one)(problem, measured, **keywords, progress=progress)
        save_result(common, found, beside)
        show_result(common, found)  # what the report is held against is computed here
        if made and common.out is None and not common.json and not common.quiet:
            _write_starter(Path(f"{session.data.stem}_problem.yaml"), problem.to_yaml())


def _read(common: Common, path: Path, problem: po.Problem) -> po.Measurements:
    with progress_bar(common, f"reading {path.name}"):  # very many rows take a while
        return po.read_measurements(path, problem)


def _starter_files(out: Path, problem: po.Problem) -> Mapping[str, bytes]:
    """The problem file that was made for the data, by name; one that somebody may have edited is not replaced."""
    files = problem.files("problem")
    for name, made in files.items():
        there = out / name
        if is_file(there) and content(there, MAX_YAML_BYTES) != made:
            hint = f"name it with --problem {there} in place of --robot, or choose another folder"
            raise InputError(Issue(f"{there} exists and says something else", OUT, str(out), hint))
    return files


def _write_starter(path: Path, text: str) -> None:
    """Write the made problem file to the working folder, unless there is one, and say so."""
    if not path.exists():
        write_text(path, text)
        click.echo(f"{path} is the problem file of this call: edit it, and name it with --problem.")
    elif content(path, MAX_YAML_BYTES) != text.encode():
        click.echo(f"{path} exists and was left as it is: it is used with --problem {path}.")


@click.command("calibrate")
@measured_options
@click.option("--no-priors", is_flag=True, help="Do not use the σ's of the problem file as priors.")
@problem_options
@common_options
def calibrate_command(common: Common, session: Session, no_priors: bool, **given: str | None) -> None:
    """Estimate every parameter of the arm that the measurements determine, with its standard error."""
    one = partial(po.calibrate, priors=not no_priors)
    answer(common, session, given, "calibrating", one, po.calibrate_batch)


@click.command("diagnose")
@measured_options
@click.option("--with-time", is_flag=True, help="Keep effects of time in extended.yaml; the task's 'time' says when.")
@problem_options
@common_options
def diagnose_command(common: Common, session: Session, with_time: bool, **given: str | None) -> None:
    """Identify what the model of the arm gets wrong, with sizes, and how much better it predicts afterwards."""

    def one(problem: po.Problem, data: po.Measurements, **keywords: Any) -> Result:
        try:
            return po.diagnose(problem, data, with_time=with_time, **keywords)
        except InsufficientDataError as error:  # a verdict, too
            error.answer = {"verdict": "insufficient_data", "effects": [], "candidates": [], "message": str(error)}
            raise

    answer(common, session, given, "diagnosing", one, partial(po.diagnose_batch, seed=common.seed))


@click.command("recheck")
@click.argument("data", type=PATH, metavar="NEW.csv")
@click.option("--update", is_flag=True, help="Write rechecked.yaml, the file with this one change, into --out or here.")
@problem_options
@common_options
def recheck_command(common: Common, data: Path, update: bool, **given: str | None) -> None:
    """Find what changed on a calibrated arm, from a few new measurements.

    NEW.csv has 5 to 30 new postures; 'plan-measurements --for recheck' chooses ten. The problem file has the
    calibrated arm with its covariance: calibrated.yaml or extended.yaml. The verdict is unchanged, changed (tool, base,
    the zero of a joint, a link, backlash or compliance of a joint, with its size and rivals), several, or unclear.
    """
    problem = deferred.request.requested_problem(**given)
    with output(common), deferred.request.placed(problem):
        with progress_bar(common, "comparing what may have changed"):
            found = po.recheck(problem, po.read_measurements(data, problem), seed=common.seed)
        files = found.updated.files("rechecked") if update and found.updated is not None else {}
        save_result(common, found, files)
        if common.out is None:
            for name, content in files.items():
                write_file(Path(name), content, OUT)
    show_result(common, found)
    if update and not common.json and not common.quiet:
        written = "rechecked.yaml" if common.out is None else common.out / "rechecked.yaml"
        none = "rechecked.yaml was not written: no single change is named."
        click.echo(none if found.updated is None else f"{written} is the file with only that changed.")
