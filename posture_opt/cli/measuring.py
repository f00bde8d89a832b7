"""``optimize-posture plan-measurements`` and ``detect``: postures to measure next, tables from pictures of boards."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.completion import PATH
from posture_opt.cli.options import Common, common_options, debug_option, problem_options, task_options
from posture_opt.cli.output import output, save_result, show_result, write_text
from posture_opt.cli.progress import progress_bar
from posture_opt.cli.robot_programs import ProgramRequest, program_options
from posture_opt.cli.scheduler import scheduler_option, working
from posture_opt.errors import BadValueError, InputError, Issue
from posture_opt.limits import MOST_CANDIDATES, MOST_PLANNED

if TYPE_CHECKING:
    from posture_opt.experiments.measurement_plan import Purpose


@click.command("plan-measurements")
@click.option(
    "--count", "--poses", "count", type=click.IntRange(min=1, max=MOST_PLANNED.most),
    help="Postures to measure.  [default: 30; 10 for a recheck]",
)  # fmt: skip
@click.option("--given", "data", type=PATH, metavar="DATA.csv", help="Measurements made already.")
@click.option(
    "--for",
    "purpose",
    type=click.Choice(["parameters", "task", "recheck"]),
    default="parameters",
    show_default=True,
    help="Inform about all parameters, the tool point at the task's posture, or changes of a calibrated arm.",
)
@click.option(
    "--candidates", type=click.IntRange(min=10, max=MOST_CANDIDATES.most), default=2000, show_default=True,
    help="Number of random postures to choose from.",
)  # fmt: skip
@click.option("--repeats", type=click.IntRange(min=1), default=1, show_default=True, help="Repeats of each posture.")
@click.option("--min", "low", metavar="TEXT", help='Lower corner of where the tool point may go: "0.3 m, -0.2 m, 0 m".')
@click.option(
    "--max", "high", metavar="TEXT", help="Its upper corner, for example the field of view of the instrument."
)
@program_options(2.0)
@problem_options
@task_options
@scheduler_option
@common_options
def plan_measurements_command(
    common: Common, count: int | None, data: Path | None, purpose: Purpose, candidates: int, link_height: str | None,
    repeats: int, low: str | None, high: str | None, motion: ProgramRequest, scheduler: str | None,
    **given: str | None,
) -> None:  # fmt: skip
    """Select the most informative postures to measure next, for the arm or for its task."""
    problem, box = deferred.request.requested_problem(**given), _box(low, high)
    height = None if link_height is None else deferred.quantities.quantity_of("--link-height", link_height)
    with output(common), deferred.request.placed(problem):
        measured = None if data is None else po.read_measurements(data, problem)
        with working(common, scheduler) as workers, progress_bar(common, "choosing postures") as progress:
            plan = po.plan_measurements(
                problem, count or (10 if purpose == "recheck" else 30), given=measured, purpose=purpose,
                seed=common.seed, link_height=height, within=box, repeats=repeats, candidates=candidates,
                executor=workers, progress=progress,
            )  # fmt: skip
        program = motion.files(common, "measure", partial(deferred.robot_program.measuring_program, plan))
        save_result(common, plan, program)
    show_result(common, plan)


def _box(low: str | None, high: str | None) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """The corners [m], world frame, of where the nominal tool point may go; one alone bounds one side."""
    issues: list[Issue] = []
    corners = deferred.quantities.corner("--min", low, issues), deferred.quantities.corner("--max", high, issues)
    lower, upper = corners[0] or (-math.inf,) * 3, corners[1] or (math.inf,) * 3
    if not issues and any(a > b for a, b in zip(lower, upper, strict=True)):
        issues.append(Issue("the box is empty: --min is above --max", ("--min",), low, "swap them"))
    if issues:
        raise InputError(issues)
    return (lower, upper) if low or high else None


@click.command("detect")
@click.argument("images", nargs=-1, required=True, type=PATH, metavar="IMAGES...")
@click.option(
    "--board", required=True, metavar="TEXT", help="charuco:5x7:30mm:22mm, chessboard:8x6:25mm, grid:8x6:25mm"
)
@click.option("--joints", type=PATH, metavar="CSV", help="Posture of every picture; default: joints.csv beside them.")
@click.option("--camera", default="camera", show_default=True, metavar="NAME", help="Name of the camera in the table.")
@click.option("--name", default="board", show_default=True, metavar="NAME", help="Name of the board in the table.")
@click.option(
    "--dictionary", default="5X5_1000", show_default=True, metavar="NAME", help="Dictionary of the ChArUco marks."
)
@click.option("--out", type=PATH, metavar="FILE", help="Write the table to a file.")
@debug_option
def detect_command(
    images: tuple[Path, ...], board: str, joints: Path | None, camera: str, name: str, dictionary: str,
    out: Path | None,
) -> None:  # fmt: skip
    """Detect a board in pictures and write a table: pixels of its points, and the joints of each picture.

    \b
    --board charuco:5x7:30mm:22mm    squares in a row x in a column, side of a square, side of a mark
    --board chessboard:8x6:25mm      inner corners in a row x in a column, side of a square
    --board grid:8x6:25mm            circles in a row x in a column, their distance

    joints.csv has a column 'image' with the names of the pictures, and columns of the joints with units. This needs
    OpenCV: pip install 'posture_opt[camera]'.
    """
    detection = deferred.board_detection
    try:
        kind = detection.Board.of(board, dictionary)
        found = detection.detect_board(images, kind, joints or images[0].with_name("joints.csv"), camera, name)
    except BadValueError as error:
        raise InputError(error.issue(("--board",), board)) from None
    write_text(out, found.text)
    none = [name for name, count in found.found.items() if not count]
    text = f"{sum(found.found.values())} points in {len(found.found) - len(none)} of {len(found.found)} pictures"
    click.echo(f"{text}; the board was not found in {', '.join(none)}" if none else text, err=True)
