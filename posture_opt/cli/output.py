"""What commands write: their documents and reports, files, and a progress bar in one line of a terminal."""

from __future__ import annotations

import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn, TextIO

import click

from posture_opt.cli.options import Common
from posture_opt.numerics import Progress
from posture_opt.output import json_text, staged_folder, writable_folder
from posture_opt.result import Result

OUT = ("--out",)
DELAY = 2.0  # s; what is done by then needs no bar
PAUSE = 0.1  # s between two drawings: faster than this nobody reads
CELLS = 30


def show(common: Common, document: Callable[[], dict[str, Any]], text: Callable[[], str]) -> None:
    """Print the JSON document or the report, whichever is asked for."""
    if common.json:
        click.echo(json_text(document()))
    elif not common.quiet:
        click.echo(text().rstrip("\n"))


def show_result(common: Common, result: Result, full: bool = True) -> None:
    """Print a result as its JSON document or as its report, the whole or its first screen."""
    show(common, result.to_json, lambda: result.report(full=full))


def save_result(common: Common, result: Result, beside: Mapping[str, bytes] | None = None) -> None:
    """Save a result, and further files beside it, where that is asked for."""
    if common.out is not None:
        result.save(common.out, figures=common.plots, beside=beside)


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
def output(common: Common) -> Iterator[None]:
    """Makes sure that results can be saved before they are computed, and cleans up when the program is ended.

    Raises:
        InputError: the folder cannot be written to; nothing was computed yet.
    """
    if common.out is None:
        yield
        return
    with _ended_politely(), writable_folder(common.out, OUT):
        yield


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
    with staged_folder(path.absolute().parent, OUT) as folder:
        (folder / path.name).write_text(text, encoding="utf-8")


class ProgressBar:
    """Draws ``what: ███░░░ 12/50, 1:20 left`` over itself; nothing before ``DELAY`` seconds are over."""

    def __init__(self, what: str, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._what, self._stream, self._clock = what, stream, clock
        self._begun = clock()
        self._next = self._begun + DELAY
        self._drawn = 0

    def show(self, done: int, total: int) -> None:
        """Draw that ``done`` of ``total`` parts are done."""
        now = self._clock()
        if now < self._next or total <= 0:
            return
        self._next = now + PAUSE
        filled = CELLS * done // total
        left = f", {_minutes((now - self._begun) * (total - done) / done)} left" if done else ""
        self._draw(f"{self._what}: {'█' * filled}{'░' * (CELLS - filled)} {done}/{total}{left}")

    def clear(self) -> None:
        """Leave the line as it was found."""
        if self._drawn:
            self._draw("")
            self._stream.write("\r")
            self._stream.flush()

    def _draw(self, line: str) -> None:
        line = line[: shutil.get_terminal_size().columns - 1]
        self._stream.write("\r" + line.ljust(self._drawn))
        self._stream.flush()
        self._drawn = len(line)


def _minutes(seconds: float) -> str:
    return f"{round(seconds) // 60}:{round(seconds) % 60:02d}"
