"""``optimize-posture plan-measurements``: which postures to measure next.

The corners of ``--min`` and ``--max`` bound the nominal tool point in the world frame [m].
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.asked.named_values import PATH
from posture_opt.cli.asked.options import Common, common_options, problem_options, task_options
from posture_opt.cli.output import output, save_result, show_result
from posture_opt.cli.progress import progress_bar
from posture_opt.cli.robot_programs import ProgramRequest, program_options
from posture_opt.cli.scheduler import scheduler_option, working
from posture_opt.errors import InputError, Issue
from posture_opt.limits import MOST_CANDIDATES, MOST_PLANNED

if TYPE_CHECKING:
    from posture_opt.experiments.measurement_plan import Purpose

_USUAL_COUNTS = {"recheck": 10}
"""Postures of a plan where no number is stated and 30 are too many."""
Corner = tuple[float, ...]
Box = tuple[Corner, Corner]


@click.command("plan-measurements")
@problem_options
@task_options
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
    help="All parameters of the arm, the tool point at the task's posture, or what changed on a calibrated arm.",
)
@click.option(
    "--candidates", type=click.IntRange(min=10, max=MOST_CANDIDATES.most), default=2000, show_default=True,
    help="Random postures to choose from.",
)  # fmt: skip
@click.option("--repeats", type=click.IntRange(min=1), default=1, show_default=True, help="Repeats of each posture.")
@click.option("--min", "low", metavar="TEXT", help='Lower corner of where the tool point may go: "0.3 m, -0.2 m, 0 m".')
@click.option(
    "--max", "high", metavar="TEXT", help="Its upper corner, for example the field of view of the instrument."
)
@program_options(2.0)
@scheduler_option
@common_options
def plan_measurements_command(
    common: Common, count: int | None, data: Path | None, purpose: Purpose, candidates: int, link_height: str | None,
    repeats: int, low: str | None, high: str | None, motion: ProgramRequest, scheduler: str | None,
    **given: str | None,
) -> None:  # fmt: skip
    """Which postures to measure next: the most informative about the arm, or about its task."""
    problem, box = deferred.requested_problem(**given), _box(low, high)
    with output(common), deferred.placed(problem):
        measured = None if data is None else po.read_measurements(data, problem)
        with working(common, scheduler) as workers, progress_bar(common, "choosing postures") as progress:
            plan = po.plan_measurements(
                problem, count or _USUAL_COUNTS.get(purpose, 30), given=measured, purpose=purpose, seed=common.seed,
                link_height=None if link_height is None else deferred.height_of(link_height), within=box,
                repeats=repeats, candidates=candidates, executor=workers, progress=progress,
            )  # fmt: skip
        save_result(common, plan, motion.files(common, "measure", partial(deferred.measuring_program, plan)))
    show_result(common, plan)


def _box(low: str | None, high: str | None) -> Box | None:
    """The corners [m], world frame, of where the tool point may go.

    One corner alone bounds one side, the other is infinite; None where neither is given.

    Args:
        low: text of ``--min``; ``high`` of ``--max``.

    Raises:
        InputError: a corner without three lengths, or an empty box.
    """
    issues: list[Issue] = []
    corners = deferred.corner("--min", low, issues), deferred.corner("--max", high, issues)
    lower, upper = corners[0] or (-math.inf,) * 3, corners[1] or (math.inf,) * 3
    if not issues and any(a > b for a, b in zip(lower, upper, strict=True)):
        issues.append(Issue("the box is empty: --min is above --max", ("--min",), low, "swap them"))
    if issues:
        raise InputError(issues)
    return (lower, upper) if low or high else None
