"""What commands write: their documents and reports, and files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import click

from posture_opt.cli.options import Common
from posture_opt.cli.progress import progress_bar
from posture_opt.output import json_text, writable_folder, write_file

if TYPE_CHECKING:
    from posture_opt.numerics import Json
    from posture_opt.result import Result

OUT = ("--out",)


def show(common: Common, document: Callable[[], Mapping[str, Json]], text: Callable[[], str]) -> None:
    """Print the JSON document or the report, whichever is asked for."""
    if common.json:
        click.echo(json_text(document()))
    elif not common.quiet:
        with progress_bar(common, "writing the report"):
            report = text()
        click.echo(report.rstrip("\n"))


def show_result(common: Common, result: Result) -> None:
    """Print a result as its JSON document or as its report, the whole or one screen of it."""
    show(common, result.to_json, lambda: result.report(full=common.full))


def save_result(common: Common, result: Result, beside: Mapping[str, bytes] | None = None) -> None:
    """Save a result into ``--out``, where that is given."""
    if common.out is not None:
        with progress_bar(common, "report and figures" if common.plots else "report") as progress:
            result.save(common.out, figures=common.plots, beside=beside, progress=progress)


@contextmanager
def output(common: Common) -> Iterator[None]:
    """Makes sure that results can be saved before they are computed, and cleans up when the program is ended."""
    if common.out is None:
        yield
        return
    with writable_folder(common.out, OUT, import_module("posture_opt.report.page.save").ALWAYS):
        yield


def write_text(path: Path | None, text: str) -> None:
    """Print ``text``, or write it to ``path`` in one go."""
    if path is None:
        click.echo(text.rstrip("\n"))
        return
    write_file(path, text.encode(), OUT)
