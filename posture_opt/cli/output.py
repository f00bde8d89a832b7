"""What commands write: documents, reports and files, and a line of progress to standard error."""

from __future__ import annotations

import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, TextIO

import click

from posture_opt.cli.options import Common
from posture_opt.encoding import json_text
from posture_opt.output import writable_folder, write_file

if TYPE_CHECKING:
    from posture_opt.numerics import Json, Progress
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


DELAY = 2.0  # s; what is done by then needs no bar
_BEGUN = time.monotonic()  # a command line program does one thing: it begins with its imports


@contextmanager
def progress_bar(common: Common, what: str) -> Iterator[Progress | None]:
    """A callback (done, total) that draws a bar on a terminal, after two seconds; None where nobody looks."""
    if common.quiet or common.json or not sys.stderr.isatty():
        yield None
        return
    now = time.monotonic()
    bar = ProgressBar(what, sys.stderr, delay=max(_BEGUN + DELAY - now, 0.3))  # a shorter stage would only flicker
    with _ticking(bar.tick):
        try:
            yield bar.show
        except BaseException:
            bar.clear()
            raise
        bar.end()


class ProgressBar:
    """Draws ``what: ███░░░ 12/50, 1:20 left`` over itself; nothing before ``delay`` seconds are over.

    The time left is ``spent · (total − done) / done``.

    Args:
        delay: before the first drawing [s].
    """

    def __init__(
        self, what: str, stream: TextIO, clock: Callable[[], float] = time.monotonic, *, delay: float = DELAY
    ) -> None:
        self._what, self._stream, self._clock = what, stream, clock
        self._begun = clock()
        self._next = self._begun + delay
        self._drawn = 0
        self._drawing = False
        self._done, self._total = 0, 0

    def show(self, done: int, total: int) -> None:
        """Draw that ``done`` of ``total`` parts are done."""
        if total > 0:
            self._done, self._total = done, total
            self.tick()

    def tick(self) -> None:
        """Draw what is known, unless that was done a moment ago."""
        now = self._clock()
        # A tick can come in the middle of a drawing.
        if now < self._next or self._drawing:
            return
        self._next = now + 0.1  # faster than this nobody reads
        spent = now - self._begun
        if not self._done:
            so_far = f"{_minutes(spent)} so far"
            self._draw(f"{self._what}: {self._bar()}, {so_far}" if self._total else f"{self._what}: {so_far}")
            return
        self._draw(f"{self._what}: {self._bar()}, {_minutes(spent * (self._total - self._done) / self._done)} left")

    def end(self) -> None:
        """All is done: a bar that was drawn is full for a moment, and the line as it was found."""
        if self._drawn and self._total:
            self._done = self._total
            self._draw(f"{self._what}: {self._bar()}")
        self.clear()

    def clear(self) -> None:
        """Leave the line as it was found."""
        if self._drawn:
            self._draw("")
            self._stream.write("\r")
            self._stream.flush()

    def _bar(self) -> str:
        filled = 30 * self._done // self._total
        return f"{'█' * filled}{'░' * (30 - filled)} {self._done}/{self._total}"

    def _draw(self, line: str) -> None:
        self._drawing = True
        line = line[: shutil.get_terminal_size().columns - 1]
        self._stream.write("\r" + line.ljust(self._drawn))
        self._stream.flush()
        self._drawn = len(line)
        self._drawing = False


@contextmanager
def _ticking(tick: Callable[[], None]) -> Iterator[None]:
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def ticked(number: int, frame: FrameType | None) -> None:
        tick()

    former = signal.signal(signal.SIGALRM, ticked)
    signal.setitimer(signal.ITIMER_REAL, 0.5, 0.5)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, former)


def print_rate(common: Common, done: int, what: str, seconds: float) -> None:
    """One line on standard error: how many were done, in what time, and how many a second; nothing of a short work."""
    if common.quiet or common.json or seconds < DELAY:
        return
    took = f"{seconds:.1f} s" if seconds < 120 else f"{_minutes(seconds)} min"
    click.echo(f"{done} {what}s in {took}: {done / seconds:.3g} a second", err=True)


def _minutes(seconds: float) -> str:
    return f"{round(seconds) // 60}:{round(seconds) % 60:02d}"
