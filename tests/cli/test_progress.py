"""The progress bar: late, in one line, and gone afterwards."""

from __future__ import annotations

import io

import pytest

from posture_opt.cli.asked.options import Common
from posture_opt.cli.progress import DELAY, ProgressBar, progress_bar


class Clock:
    """Time that a test moves."""

    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def terminal():
    return io.StringIO()


def test_bar_comes_late_and_goes(clock, terminal):
    bar = ProgressBar("starts", terminal, clock)
    clock.now += DELAY - 0.01
    bar.show(5, 32)
    assert terminal.getvalue() == ""
    clock.now += 8.01
    bar.show(8, 32)
    assert terminal.getvalue() == f"\rstarts: {'█' * 7}{'░' * 23} 8/32, 0:30 left"
    bar.show(9, 32)
    assert "9/32" not in terminal.getvalue(), "too soon after the former"
    bar.clear()
    assert terminal.getvalue().endswith("\r" + " " * len("starts: 8/32, 0:30 left ") + " " * 30 + "\r")


def test_shorter_line_covers_the_longer(clock, terminal):
    bar = ProgressBar("rows", terminal, clock)
    for done, seconds in ((1, 1000), (99, 1)):
        clock.now += seconds
        bar.show(done, 100)
    _, first, second = terminal.getvalue().split("\r")
    assert len(first) == len(second)
    assert second.rstrip() == f"rows: {'█' * 29}░ 99/100, 0:10 left"


def test_a_narrow_terminal_keeps_one_line(clock, terminal, monkeypatch):
    monkeypatch.setenv("COLUMNS", "20")
    bar = ProgressBar("choosing postures", terminal, clock)
    clock.now += DELAY
    bar.show(0, 3)
    assert terminal.getvalue() == "\rchoosing postures: "


def test_nothing_done_and_nothing_to_do(clock, terminal):
    bar = ProgressBar("rows", terminal, clock)
    clock.now += DELAY
    bar.show(0, 0)
    assert terminal.getvalue() == ""
    bar.show(0, 3)
    assert terminal.getvalue().endswith("0/3, 0:02 so far"), "no guess of the time left"


@pytest.mark.parametrize(("quiet", "tty"), [(True, True), (False, False)])
def test_no_bar_where_nobody_looks(quiet, tty, monkeypatch):
    monkeypatch.setattr("sys.stderr", stream := io.StringIO())
    stream.isatty = lambda: tty
    with progress_bar(Common(quiet=quiet), "starts") as progress:
        assert progress is None
    assert stream.getvalue() == ""


def test_bar_on_a_terminal(monkeypatch):
    monkeypatch.setattr("posture_opt.cli.progress._BEGUN", -1e9)
    monkeypatch.setattr("posture_opt.cli.progress.STAGE_DELAY", 0.0)
    monkeypatch.setattr("sys.stderr", stream := io.StringIO())
    stream.isatty = lambda: True
    with progress_bar(Common(), "starts") as progress:
        progress(1, 2)
    assert stream.getvalue().startswith("\rstarts: ")
    assert stream.getvalue().rstrip(" \r").endswith("2/2"), "full at the end"
