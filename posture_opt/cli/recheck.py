"""``optimize-posture recheck``: what changed on a calibrated arm since its file was made.

The command reads, computes, saves and prints; the mathematics is in ``posture_opt.changes``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.asked.named_values import PATH
from posture_opt.cli.asked.options import Common, common_options, problem_options
from posture_opt.cli.output import output, save_result, show_result, write_content
from posture_opt.cli.progress import progress_bar

if TYPE_CHECKING:
    from collections.abc import Mapping


@click.command("recheck")
@click.argument("data", type=PATH, metavar="NEW.csv")
@problem_options
@click.option(
    "--update", is_flag=True, help="Write rechecked.yaml, the file with only that changed, into --out or here."
)
@common_options
def recheck_command(common: Common, data: Path, update: bool, **given: str | None) -> None:
    """Whether the arm is still the one that was calibrated, and if not, what changed.

    NEW.csv has 5 to 30 new postures ('plan-measurements --for recheck' chooses ten), the problem file the calibrated
    arm with its covariance: calibrated.yaml or extended.yaml. The answer is one of: unchanged; one thing changed
    (tool, base, the zero of a joint, a link, backlash or compliance of a joint), with its size and its rivals; more
    than one thing.
    """
    problem = deferred.requested_problem(**given)
    with output(common), deferred.placed(problem):
        with progress_bar(common, "comparing what may have changed"):
            found = po.recheck(problem, po.read_measurements(data, problem), seed=common.seed)
        files: Mapping[str, bytes] = found.updated.files("rechecked") if update and found.updated is not None else {}
        save_result(common, found, files)
        if common.out is None:
            for name, content in files.items():
                write_content(Path(name), content)
    show_result(common, found)
    if update and not common.json and not common.quiet:
        click.echo(_said(found, common.out))


def _said(found: po.Recheck, out: Path | None) -> str:
    """What became of ``--update``."""
    if found.updated is None:
        return "rechecked.yaml was not written: no single change is named."
    return f"{Path('rechecked.yaml') if out is None else out / 'rechecked.yaml'} is the file with only that changed."
