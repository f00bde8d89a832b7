"""``optimize-posture batch``: the postures of many problem files.

Problems are independent: workers solve them in any order, and a checkpoint keeps those that are done.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

import posture_opt as po
from posture_opt.cli.asked.named_values import PROBLEM
from posture_opt.cli.asked.options import Common, common_options
from posture_opt.cli.output import output, save_result, show_result
from posture_opt.cli.progress import print_rate, progress_bar
from posture_opt.cli.scheduler import checkpoint_option, digest_of, scheduler_option, working
from posture_opt.errors import InputError

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem
    from posture_opt.selection.posture_batch import PostureBatch

_MAX_FAILURES = 20
"""Problems without an answer whose reasons are printed beside no report."""


@click.command("batch")
@click.argument("files", nargs=-1, required=True, type=PROBLEM, metavar="FILE…")
@scheduler_option
@checkpoint_option
@common_options
def batch_command(common: Common, files: Sequence[str], scheduler: str | None, checkpoint: Path | None) -> None:
    """The postures of many problem files, in one report.

    A file that cannot be read, or has no solution, has a row that says why, and the others their answers. The exit
    code is then the least of those that the files have alone: 2 before 3.
    """
    if len(set(files)) < len(files):
        twice = next(name for name in files if files.count(name) > 1)
        raise click.UsageError(f"{twice} is named twice: name different problem files.")
    problems = {name: _read(name) for name in files}
    read = {name: p for name, p in problems.items() if not isinstance(p, InputError)}
    pages = common.out is not None and common.plots
    asked = {
        "seed": common.seed,
        "pages": pages,
        "problems": [[name, digest_of(problem)] for name, problem in read.items()],
    }
    with output(common):
        work = working(common, scheduler, checkpoint, command="batch", **asked)
        with work as workers, progress_bar(common, "problems") as progress:
            found = po.select_postures(problems, seed=common.seed, pages=pages, executor=workers, progress=progress)
        save_result(common, found)
    show_result(common, found)
    if common.quiet and not common.json:
        _print_failures(found)
    print_rate(common, len(found.answers), "problem", found.seconds)
    sys.exit(found.code)


def _print_failures(found: PostureBatch) -> None:
    """Why problems have no answer, on standard error: what the report says where there is one."""
    failed = [answer for answer in found.answers if answer.code]
    for answer in failed[:_MAX_FAILURES]:
        click.echo(f"error: {answer.name}: {'; '.join(answer.reasons)}", err=True)
    if len(failed) > _MAX_FAILURES:
        click.echo(f"error: {len(failed) - _MAX_FAILURES} more problems have no answer", err=True)


def _read(name: str) -> Problem | InputError:
    """The problem of a file, or what is wrong with it: a row of the report says so."""
    try:
        return po.load_problem(name)
    except InputError as error:
        return error
