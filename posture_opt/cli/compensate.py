"""``optimize-posture compensate``: joint values that bring this arm, with its errors, to targets.

The command reads, computes, saves and prints; the mathematics is in ``posture_opt.compensation``.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.asked.named_values import PATH
from posture_opt.cli.asked.options import Common, common_options, problem_options
from posture_opt.cli.output import output, save_result, show_result
from posture_opt.cli.progress import progress_bar
from posture_opt.cli.robot_programs import ProgramRequest, program_options


@click.command("compensate")
@click.argument("targets", type=PATH, metavar="TARGETS.csv")
@problem_options
@program_options(0.0, touching=True)
@common_options
def compensate_command(common: Common, targets: Path, motion: ProgramRequest, **given: str | None) -> None:
    """Joint values that bring the tool of this arm, with its corrections and effects, to the targets.

    TARGETS.csv has x, y, z with units, optionally qw, qx, qy, qz, and joint columns that say which posture to stay
    near; or joint columns alone, which stand for where the nominal arm would be with them. Without joint columns the
    tool axis, the tilt and the requirements of the task hold, near its posture; the cell is kept clear of either way.
    JOINT.approach and payload count as in measurements. The answer, compensated.csv, has the rows of the targets in
    their units.
    """
    problem = deferred.requested_problem(**given)
    with output(common), deferred.placed(problem):
        with progress_bar(common, "compensating"):
            found = po.compensate(problem, targets)
        program = motion.files(common, "compensated", partial(deferred.compensated_program, found))
        save_result(common, found, program)
    show_result(common, found)
