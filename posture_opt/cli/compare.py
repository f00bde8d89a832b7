"""The command ``compare``: one task for several problem files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

import posture_opt as po
from posture_opt.cli.named import PROBLEM
from posture_opt.cli.options import Common, common_options
from posture_opt.cli.output import output, save_result, show_result
from posture_opt.cli.progress import progress_bar
from posture_opt.cli.request import placed, requested_problem


@click.command("compare")
@click.argument("problems", nargs=-1, required=True, type=PROBLEM, metavar="A.yaml B.yaml")
@common_options
def compare_command(common: Common, problems: Sequence[str]) -> None:
    """The task of the first problem file with the arm of each: postures, spread, probability of success.

    The files state two arms, or two states of knowledge of one arm, as before and after a calibration. Where the joints
    are the same, each posture is also judged by the other arm: where that one would land with it.
    """
    if len(problems) < 2:
        raise click.UsageError("Name two problem files, for example: compare before.yaml after.yaml")
    if len(set(problems)) < len(problems):
        raise click.UsageError(f"{problems[0]} is named twice: name two different problem files.")
    asked = dict(zip(_names(problems), (requested_problem(name, None) for name in problems), strict=True))
    first = next(iter(asked.values()))
    with output(common):
        with progress_bar(common, "arms") as progress, placed(first):
            found = po.compare(asked, seed=common.seed, workers=common.workers, progress=progress)
        save_result(common, found)
    show_result(common, found)


def _names(problems: Sequence[str]) -> list[str]:
    """Stems of the files, or the whole paths where two of them are called the same."""
    stems = [Path(problem).stem for problem in problems]
    return stems if len(set(stems)) == len(stems) else list(problems)
