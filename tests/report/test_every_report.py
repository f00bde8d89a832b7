"""Reports of arms in space, and without an answer; those of every kind of result: ``tests/test_results.py``."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import posture_opt as po
from tests.helpers.every_result import MADE
from tests.helpers.report_words import PATTERN, assert_report
from tests.helpers.source import modules_of
from tests.helpers.variants import conformance

PACKAGE = Path(po.__file__).parent
REPORTS: dict[str, Callable[[], Any]] = {
    "six joints": lambda: po.select_posture(po.load_problem("insert_ur10")),
    "seven joints": lambda: po.select_posture(po.load_problem("insert_panda")),
    "peg": lambda: po.select_posture(po.load_problem("insert_ur10_peg")),
    "a spread in space": lambda: po.propagate(po.load_problem("insert_ur10"), [0.5, -2.2, -1.5, 2.1, -1.6, 0.0]),
}


@pytest.mark.parametrize("name", conformance(REPORTS, ["a spread in space"]))
def test_a_report_fits_its_screen_and_speaks_the_words_of_the_field(name: str) -> None:
    assert_report(REPORTS[name]())


def test_so_does_one_without_an_answer() -> None:
    task = {"kind": "insert", "direction": [0, -1, 0], "position": ["2.5 m", "0 m", "0 m"]}
    robot, sigma = {"kind": "preset", "name": "planar_2r"}, {"joint1.theta": "1 deg"}
    with pytest.raises(po.errors.NoSolutionError) as caught:
        po.select_posture(po.problem_from_dict({"robot": robot, "uncertainty": {"sigma": sigma}, "task": task}))
    assert_report(caught.value.solution, answered=False)


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
