"""The command ``compare``: one task for several problem files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.asked.named_values import PROBLEM
from posture_opt.cli.asked.options import Common, common_options, task_options
from posture_opt.cli.output import output, save_result, show_result
from posture_opt.cli.progress import progress_bar
from posture_opt.files import is_there, preset_names

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem


@click.command("compare")
@click.argument("problems", nargs=-1, required=True, type=PROBLEM, metavar="A.yaml B.yaml")
@task_options
@common_options
def compare_command(common: Common, problems: Sequence[str], **given: str | None) -> None:
    """The task of the first problem file with the arm of each: postures, spread, probability of success.

    The files state two arms, or two states of knowledge of one arm, as before and after a calibration; a preset stands
    for its arm. Options of the task hold for all. Where the joints are the same, each posture is also judged by the
    other arm: where that one would land with it.
    """
    if len(problems) < 2:
        raise click.UsageError("Name two problem files, for example: compare before.yaml after.yaml")
    if len(set(problems)) < len(problems):
        raise click.UsageError(f"{problems[0]} is named twice: name two different problem files.")
    asked = dict(zip(_names(problems), (_requested(name, given) for name in problems), strict=True))
    first = next(iter(asked.values()))
    with output(common):
        with progress_bar(common, "arms") as progress, deferred.placed(first):
            found = po.compare(asked, seed=common.seed, workers=common.workers, progress=progress)
        save_result(common, found)
    show_result(common, found)


def _requested(name: str, given: Mapping[str, str | None]) -> Problem:
    """The problem of a file, of a built-in name, or of a preset."""
    if name in preset_names() and not is_there(Path(name)):
        return deferred.requested_problem(None, name, **given)
    return deferred.requested_problem(name, **given)


def _names(problems: Sequence[str]) -> list[str]:
    """Stems of the files, or the whole paths where two of them are called the same."""
    stems = [Path(problem).stem for problem in problems]
    return stems if len(set(stems)) == len(stems) else list(problems)
