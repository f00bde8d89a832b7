"""Every statement of postures, maps and comparisons that the catalogue has is made somewhere, and reads well."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.report.text.lead import fits, lead
from posture_opt.result import Result
from posture_opt.statements import Statement, every_entry
from tests.helpers.every_result import MADE
from tests.helpers.said import said

MINE = ("Solution", "Solution of a path", "Solution of features", "TargetMap", "PostureBatch", "Comparison",
        "Comparison of arms", "Compensation")  # fmt: skip
PRINTABLE = re.compile(r"[{}]|\bnan\b|\binf\b")


def made(name: str, **keys: Any) -> po.Solution:
    """The answer to a shipped problem with other keys of its file."""
    problem = po.load_problem(name)
    return po.select_posture(problem.replace(**keys) if keys else problem)


@pytest.mark.parametrize("name", MINE)
def test_the_first_screen_has_the_answer_and_its_limits(name: str) -> None:
    result = MADE[name]()
    shown, _ = lead(result.statements)
    assert fits(shown)
    assert shown[0].severity == "result"
    document = result.to_json()["statements"]
    assert [one["id"] for one in document] == [one.id for one in sorted(result.statements, key=_weight)]  # type: ignore[index, union-attr]
    assert {one["text"] for one in document} == {one.text for one in result.statements}  # type: ignore[index, union-attr]


def _weight(one: Statement) -> int:
    return ["danger", "caution", "result", "note", "detail"].index(one.severity)


def test_a_sentence_has_at_most_25_words_of_its_own() -> None:
    rooms = ("selection", "collision", "compensation", "problem", "uncertainty")
    entries = {name: entry for name, entry in every_entry().items() if name.partition(".")[0] in rooms}
    assert {name: len(entry.text.split()) for name, entry in entries.items() if len(entry.text.split()) > 25} == {}
    assert all(entry.text.endswith((".", ")")) for entry in entries.values())


def test_a_taught_position_is_the_condition_of_its_probability() -> None:
    """Repeatability says nothing of where the arm is in the world; stated errors that stay do."""
    task = {"kind": "insert", "direction": [0, -1, 0], "position": ["0.9 m", "0.4 m", "0 m"], "clearance": "50 mm"}
    ids = {}
    for name, errors in {
        "taught": {"repeatability": "0.1 mm"},
        "placed": {"sigma": {"joint1.theta": "1 mrad"}},
    }.items():
        robot = {"kind": "preset", "name": "planar_2r"}
        found = po.select_posture(po.problem_from_dict({"robot": robot, "uncertainty": errors, "task": task}))
        ids[name] = {one for one in said(found) if "success" in one}
        assert "> 99.9 %" in found.report()
    assert ids == {"taught": {"uncertainty.success-taught"}, "placed": {"uncertainty.success"}}


def test_a_joint_that_spins_the_tool_about_its_axis_is_free_and_any_value_as_good() -> None:
    found = made("insert_ur10")
    (name,) = said(found)["selection.free-joint"].values["joints"]  # type: ignore[misc, union-attr]
    at = found.problem.robot.joint_names.index(str(name))
    turned = np.array(found.q)
    turned[at] += 1.0
    assert found.sigma_at(found.target, turned) == pytest.approx(found.sigma_max, rel=1e-9)


def texts(result: Result) -> str:
    return " ".join(one.text for one in result.statements)


@pytest.mark.parametrize("name", MINE)
def test_sentences_are_filled(name: str) -> None:
    text = texts(MADE[name]())
    for keys in re.findall(r"\{[a-z_]+: [^{}]*\}", text):  # of problem files
        text = text.replace(keys, "")
    assert PRINTABLE.search(text) is None
