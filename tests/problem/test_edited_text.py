"""A problem file with other values: read again it says them, and every comment is where it was."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

import posture_opt as po
from posture_opt.problem.yaml_source import edited, parse_yaml

PROBLEMS = Path(__file__).parents[2] / "problems"
CELL = (PROBLEMS / "insert_ur10_cell.yaml").read_text(encoding="utf-8")


def comments(text: str) -> list[str]:
    return [line.split("#", 1)[1] for line in text.splitlines() if "#" in line]


@pytest.mark.parametrize(
    "changes",
    [
        {"task__position": ["500.0 mm", "1.0 mm", "0.0 mm"]},
        {"task__position": ["500.0 mm", "1.0 mm", "0.0 mm"], "task__clearance": "0.1 mm"},
        {"uncertainty__repeatability": "0.05 mm"},
        {"uncertainty__sigma": {"elbow.theta": "1 mrad", "base.x": "1 mm"}, "task__tilt": "5 deg"},
        {"cell__obstacles__lamp__radius": "90 mm", "cell__obstacles__post__rpy": ["1 deg", "0 deg", "0 deg"]},
        {"cell__clearance": None, "name": "it's: #1 \N{SNOWMAN}"},
        {"task__criterion": "trace", "solver": {"starts": 8}},
    ],
)
def test_only_what_differs_is_written_anew(changes: dict[str, Any]) -> None:
    wanted = po.load_problem("insert_ur10_cell").replace(**changes).to_dict()
    text = edited(CELL, wanted)
    assert text is not None
    assert yaml.safe_load(text) == wanted
    kept = [words for words in comments(CELL) if "of the arm to all" not in words or "cell__clearance" not in changes]
    assert [words for words in comments(text) if words in kept] == kept


@pytest.mark.parametrize("file", sorted(PROBLEMS.glob("*.yaml")), ids=lambda file: file.stem)
def test_every_shipped_file_can_be_given_another_name_and_section(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    data = parse_yaml(text).data
    wanted = {**data, "name": "another", "solver": {"seed": 7}}
    found = edited(text, wanted)
    assert found is not None
    assert parse_yaml(found).data == wanted
    assert "solver" in data or comments(text) == comments(found)


def test_what_an_alias_shares_is_not_changed_for_one_of_its_keys() -> None:
    assert edited("a: &x {b: 1}\nc: *x\n", {"a": {"b": 2}, "c": {"b": 1}}) is None
