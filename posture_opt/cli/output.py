"""What leaves the program: JSON text, progress, and files that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import click

from posture_opt.cli.options import Common
from posture_opt.cli.progress import ProgressBar
from posture_opt.errors import InputError, Issue
from posture_opt.numerics import Progress
from posture_opt.report.document import json_text

Answer = tuple[Callable[[], dict[str, Any]], Callable[[], str]]
"""What a command can show: its JSON document and its report."""


def show(common: Common, document: Callable[[], dict[str, Any]], text: Callable[[], str]) -> None:
    """Print the JSON document or the report, whichever is asked for."""
    if common.json:
        click.echo(json_text(document()))
    elif not common.quiet:
        click.echo(text().rstrip("\n"))


def rendered(report: str, *arguments: object) -> Callable[[], str]:
    """What prints a report, ``posture_opt.report.REPORT.REPORT(*arguments)``, imported only when it is asked for."""

    def text() -> str:
        from posture_opt.report.text import render

        return render(getattr(import_module(f"posture_opt.report.{report}"), report)(*arguments))

    return text


@contextmanager
def progress_bar(common: Common, what: str) -> Iterator[Progress | None]:
    """A callback (done, total) that draws a bar on a terminal, after two seconds; None where nobody looks."""
    if common.quiet or not sys.stderr.isatty():
        yield None
        return
    bar = ProgressBar(what, sys.stderr)
    try:
        yield bar.show
    finally:
        bar.clear()


@contextmanager
def output_folder(out: Path | None) -> Iterator[Path | None]:
    """A folder to write into, whose files move to ``out`` when all went well and vanish when anything did not.

    Raises:
        InputError: ``out`` cannot be written to; nothing was computed yet.
    """
    if out is None:
        yield None
        return
    made = _missing_parents(out)
    staging = _staging(out)
    try:
        with _ended_politely():
            yield staging
            _move_into_place(staging, out)
    except OSError as error:
        if error.filename is None or str(staging) not in str(error.filename):
            raise
        raise InputError(Issue(f"cannot write to {out}: {error.strerror}", ("--out",))) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        _remove_empty(made)


def _missing_parents(out: Path) -> list[Path]:
    return [folder for folder in out.absolute().parents if not folder.exists()]


def _staging(out: Path) -> Path:
    """A new folder in the file system of ``out``: inside it where it exists, else beside it."""
    try:
        if out.exists() and not out.is_dir():
            raise NotADirectoryError(20, "this is a file, not a folder")
        if not out.exists():
            out.absolute().parent.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(prefix=".posture_opt-", dir=out if out.exists() else out.absolute().parent))
    except OSError as error:
        message = f"cannot write to {out}: {(error.strerror or str(error)).lower()}"
        raise InputError(Issue(message, ("--out",), str(out), "name a folder that you may write to")) from None


def _move_into_place(staging: Path, out: Path) -> None:
    if not out.exists():
        umask = os.umask(0)
        os.umask(umask)
        staging.chmod(0o777 & ~umask)  # a temporary folder is private, the result is not
        staging.rename(out)
        return
    stale = _stale(staging, out)
    for file in sorted(path for path in staging.rglob("*") if path.is_file()):
        target = out / file.relative_to(staging)
        target.parent.mkdir(parents=True, exist_ok=True)
        file.replace(target)
    for file in stale:
        file.unlink(missing_ok=True)


def _stale(staging: Path, out: Path) -> list[Path]:
    """Files of an earlier report in ``out`` that the new one does not replace: they would pass for its own."""
    if not (staging / "report.html").exists():
        return []
    from posture_opt.report.write import DOCUMENTS, OWN_FILES

    former = {name for name in OWN_FILES if (out / name).is_file()}
    # A figure alone may be anybody's; a report of ours never comes without one of these.
    reported = former & set(DOCUMENTS)
    return sorted(out / name for name in former if reported and not (staging / name).exists())


def _remove_empty(folders: list[Path]) -> None:
    """Folders that were made on the way are removed where nothing came of it."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return


@contextmanager
def _ended_politely() -> Iterator[None]:
    """A request to end runs the clean-up first."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, frame: Any) -> NoReturn:
        sys.exit(128 + number)

    former = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, former)


def write_text(path: Path | None, text: str) -> None:
    """Print ``text``, or write it to ``path`` in one go.

    Raises:
        InputError: the file cannot be written.
    """
    if path is None:
        click.echo(text.rstrip("\n"))
        return
    with output_folder(path.absolute().parent) as folder:
        assert folder is not None
        (folder / path.name).write_text(text, encoding="utf-8")
