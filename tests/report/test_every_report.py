"""Every report fits on one screen of any width with its answer first, in the words of the field."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import posture_opt as po
from posture_opt.report.text.screen import SCREEN
from tests.helpers.every_result import MADE
from tests.helpers.source import modules_of
from tests.helpers.variants import conformance

PACKAGE = Path(po.__file__).parent
WIDTHS = (80, 100, 140)
NUMBER = re.compile(r"\d")
ERROR_IN_DEGREES = re.compile(
    r"± [\d.]+ (deg|arcsec)|arcsec|(?<![\d.])0\.0\d*[1-9]\d* deg|(error|RMS|dev\.|σ)[^|\n]{0,12}\[deg\]"
)
"""Errors of angles are in mrad, angles in deg: what is below 0.1 deg is an error."""
TOO_MANY_DECIMALS = re.compile(r"\d\.\d{7,}")  # of a nanometre, a nanoradian: rounding
WORD_PARTED = re.compile(r"[a-z]-$")  # a line that ends inside a word


def out_of_reach() -> Any:
    task = {"kind": "insert", "direction": [0, -1, 0], "position": ["2.5 m", "0 m", "0 m"]}
    robot, sigma = {"kind": "preset", "name": "planar_2r"}, {"joint1.theta": "1 deg"}
    with pytest.raises(po.errors.NoSolutionError) as caught:
        po.select_posture(po.problem_from_dict({"robot": robot, "uncertainty": {"sigma": sigma}, "task": task}))
    assert caught.value.solution is not None
    return caught.value.solution


REPORTS: dict[str, Callable[[], Any]] = {
    **MADE,
    "six joints": lambda: po.select_posture(po.load_problem("insert_ur10")),
    "seven joints": lambda: po.select_posture(po.load_problem("insert_panda")),
    "peg": lambda: po.select_posture(po.load_problem("insert_ur10_peg")),
    "a spread in space": lambda: po.propagate(po.load_problem("insert_ur10"), [0.5, -2.2, -1.5, 2.1, -1.6, 0.0]),
    "no solution": out_of_reach,
}

FORBIDDEN = (
    # what a native reader stumbles on, from the table of words in use
    r"\bgives? way\b", r"\bhas play\b", r"has a name", r"\bhas no name yet\b", r"\bas it stands\b", r"\bcomes to lie\b",
    r"as it must be", r"\bhit \d+ times", r"\bis left out: the axis", r"nothing of note", r"meets the clearance",
    r"cycles a turn", r"by chance 1 in", r"better than a million", r"noise alone makes", r"had not been seen",
    r"scatters? by\b", r"of the time\b", r"\bmore by\b", r"does not count here", r"\bdo what\b", r"no chance",
    r"\bgives away\b", r"\bminds?\b", r"\bhang together\b", r"\bbeforehand\b", r"\bumbrella\b", r"\bsuspects?\b",
    r"practically (always|never)", r"\bthen scatters\b", r"so much more\b", r"\btells? most\b", r"what is no\b",
    r"to every side\b", r"\bno news\b", r"may be trusted", r"\bposture that does it\b", r"\bfree of it\b",
)  # fmt: skip
PATTERN = re.compile("|".join(FORBIDDEN), re.IGNORECASE)


@pytest.mark.parametrize("name", conformance(REPORTS, REPORTS.keys() - {"seven joints", "peg"}))
def test_a_report_fits_its_screen_and_speaks_the_words_of_the_field(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    result = REPORTS[name]()
    for width in WIDTHS:
        monkeypatch.setenv("COLUMNS", str(width))
        check(result, width)
    text = " ".join(result.report().split())
    for pattern in (PATTERN, ERROR_IN_DEGREES, TOO_MANY_DECIMALS):
        found = pattern.search(text)
        assert found is None, text[max(found.start() - 60, 0) : found.end() + 60]


def check(result: Any, width: int) -> None:
    """Whether a report fits, answers at once, and breaks no word."""
    short, full = result.report(full=False), result.report()
    lines = short.rstrip("\n").splitlines()
    assert len(lines) <= SCREEN
    assert NUMBER.search(" ".join(lines[1:4])), "the answer stands in the first three lines under the title"
    assert "--out DIR writes report.html" in " ".join(short.split())
    words = {word for line in full.splitlines() for word in line.split()}
    for text in (short, full):
        assert max(map(len, text.splitlines())) <= width
        assert not any(WORD_PARTED.search(line) for line in text.splitlines())
    for joint in _joints(result):
        parts = {joint[:k] for k in range(3, len(joint))} - {"shoulder", "elbow", "wrist"}  # words of configurations
        assert not parts & words, "a joint's name is broken"


def _joints(result: Any) -> tuple[str, ...]:
    problem = getattr(result, "problem", None)
    names: tuple[str, ...] = problem.robot.joint_names if problem is not None else ()
    return tuple(name for name in names if "_" in name)


def test_messages_speak_the_words_of_the_field() -> None:
    found = [
        f"{module.path.relative_to(PACKAGE)}:{node.lineno}: {node.value.strip()}"
        for module in modules_of(PACKAGE).values()
        for node in module.strings()
        if " " in node.value and PATTERN.search(node.value)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("name", ["Solution", "Solution of features"])
def test_standard_deviations_of_a_report_have_one_unit(name: str) -> None:
    """That of the answer, whatever the size of what is beside it."""
    text = MADE[name]().report()
    assert len(set(re.findall(r"(?:std\. dev\.|σ across [a-z ]*) \[(µm|mm)\]", text))) == 1
