"""Many problems at once: the answers of single solves, whoever works, and a row for what fails."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

import posture_opt as po
from posture_opt.workers.processes import ProcessWorkers
from tests.helpers.command_line import invoke

NAMES = ("insert_planar_2r", "insert_planar_2r_fixed_hole")


def plain(document: object) -> str:
    """JSON text without wall times."""

    def untimed(value: object) -> object:
        if isinstance(value, dict):
            return {key: untimed(entry) for key, entry in value.items() if key != "seconds"}
        return [untimed(entry) for entry in value] if isinstance(value, list) else value

    return json.dumps(untimed(document))


def test_the_answers_are_those_of_single_solves_whoever_works() -> None:
    problems = {name: po.load_problem(name) for name in NAMES}
    alone = po.select_postures(problems)
    with ProcessWorkers(2) as workers:
        shared = po.select_postures(problems, executor=workers)
    assert plain(shared.to_json()) == plain(alone.to_json())
    assert alone.code == 0
    for name, answer in zip(NAMES, alone.answers, strict=True):
        single = po.select_posture(problems[name])
        assert answer.name == name
        assert answer.sigma_max == single.critical.sigma_max
        assert answer.document is not None
        assert answer.document["posture"] == dict(single.posture)


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    out_of_reach = po.load_problem("insert_planar_2r_fixed_hole").with_task(position=["9 m", "0 m", "0 m"])
    written = {"far": out_of_reach.to_yaml(), "bad": "robot: {kind: dh, joints: 3}\n"}
    for name, text in written.items():
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    return {name: tmp_path / f"{name}.yaml" for name in written}


def test_a_bad_file_has_its_row_and_the_others_their_answers(files: dict[str, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["batch", "insert_planar_2r", files["far"], files["bad"], "drill_planar_2r"]
    result = invoke(*words, "--out", out, "--no-plots")
    assert result.exit_code == 2
    assert "2 of 4 problems solved.\nFailed    1 with bad input and 1 without a solution." in result.stdout
    assert "joints" in result.stdout
    with (out / "answers.csv").open(encoding="utf-8") as table:
        rows = list(csv.DictReader(table, skipinitialspace=True))
    assert [row["code"] for row in rows] == ["0", "3", "2", "0"]
    assert [row["status"] for row in rows] == ["optimal", "infeasible", "failed", "optimal"]
    assert all(bool(row["reason"]) == (row["code"] != "0") for row in rows)
    document = json.loads((out / "answers.json").read_text(encoding="utf-8"))
    assert document["code"] == 2
    assert document["answers"][1]["solution"]["reasons"]


def test_the_exit_code_is_that_of_what_to_mend_first(files: dict[str, Path]) -> None:
    assert invoke("batch", "insert_planar_2r", "--quiet").exit_code == 0
    assert invoke("batch", "insert_planar_2r", files["far"], "--quiet").exit_code == 3
    alone = invoke("batch", files["bad"])
    assert alone.exit_code == 2
    assert "joints" in alone.stderr
    twice = invoke("batch", "insert_planar_2r", "insert_planar_2r")
    assert twice.exit_code == 2
    assert "named twice" in twice.stderr


def test_a_batch_goes_on_where_it_was(tmp_path: Path) -> None:
    words = ["batch", *NAMES, "--checkpoint", tmp_path / "kept", "--json"]
    first, again = invoke(*words), invoke(*words)
    assert first.exit_code == again.exit_code == 0
    once, twice = (json.loads(result.stdout) for result in (first, again))
    assert once["answers"] == twice["answers"]
    assert "another problems" in invoke("batch", *NAMES[:1], "--checkpoint", tmp_path / "kept").stderr
