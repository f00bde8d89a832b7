"""What every report is: on one screen of any width, its answer first, sentences filled, in the words of the field."""

from __future__ import annotations

import re
from typing import Any

import pytest

from posture_opt.report.text.blocks import fits, lead
from posture_opt.report.text.screen import SCREEN

WIDTHS = (80, 100, 140)
NUMBER = re.compile(r"\d")
ERROR_IN_DEGREES = re.compile(
    r"± [\d.]+ (deg|arcsec)|arcsec|(?<![\d.])0\.0\d*[1-9]\d* deg|(error|RMS|dev\.|σ)[^|\n]{0,12}\[deg\]"
)
"""Errors of angles are in mrad, angles in deg: what is below 0.1 deg is an error."""
TOO_MANY_DECIMALS = re.compile(r"\d\.\d{7,}")  # of a nanometre, a nanoradian: rounding
UNFILLED = re.compile(r"[{}]|\bnan\b|\binf\b")
WORD_PARTED = re.compile(r"[a-z]-$")  # a line that ends inside a word

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


def assert_report(result: Any, answered: bool = True) -> None:
    """``answered``: the first sentence is the answer, and not a danger."""
    for width in WIDTHS:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("COLUMNS", str(width))
            check(result, width)
    shown, _ = lead(result.statements)
    assert fits(shown)
    assert shown[0].severity == "result" or not answered
    document = result.to_json()["statements"]
    assert [one["id"] for one in document] == [one.id for one in sorted(result.statements, key=_weight)]
    assert {one["text"] for one in document} == {one.text for one in result.statements}
    # Keys of problem files have braces of their own.
    filled = re.sub(r"\{[a-z_]+: [^{}]*\}", "", " ".join(one.text for one in result.statements))
    assert UNFILLED.search(filled) is None
    text = " ".join(result.report().split())
    for pattern in (PATTERN, ERROR_IN_DEGREES, TOO_MANY_DECIMALS):
        found = pattern.search(text)
        assert found is None, text[max(found.start() - 60, 0) : found.end() + 60]


def _weight(one: Any) -> int:
    return ["danger", "caution", "result", "note", "detail"].index(one.severity)


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
