"""Problem files that are right: what they mean, the way there and back, and those that travel with the package."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.problem.parts import parse_spec
from posture_opt.problem.yaml_source import ProblemDocument, dump_yaml, edited, parse_yaml
from tests.helpers.shipped import PROBLEMS, builtin_names, json_schema

DEG = math.pi / 180

PLANAR = {
    "name": "Vertical insertion",
    "robot": {
        "kind": "dh",
        "joints": [
            {"name": "joint1", "type": "revolute", "a": "1 m", "limits": ["-180 deg", "180 deg"]},
            {"name": "joint2", "type": "revolute", "a": "100 cm", "limits": ["-3.0 rad", "0.5 rev"]},
        ],
    },
    "uncertainty": {
        "sigma": {"joint1.theta": "60 arcmin", "joint2.theta": "3 deg", "joint1.a": "10 mm", "joint2.a": "1e4 um"},
        "correlation": [["joint1.a", "joint2.a", "8e-1"]],
        "measurement": {"position": "0.05 mm"},
    },
    "task": {"kind": "insert", "direction": [0, -1, 0], "clearance": "0.2 mm"},
    "effects": [],
    "solver": {"kind": "ipopt", "starts": 8, "seed": 3},
    "data": {"distances": [["front/0", "front/1", "50 mm"]]},
}


def test_quantities_are_si_inside() -> None:
    problem = po.problem_from_dict(PLANAR)
    assert problem.name == "Vertical insertion"
    assert problem.robot.upper[1] == pytest.approx(math.pi, rel=1e-15)
    assert problem.robot.lower[1] == -3.0
    assert problem.sources.names == ("joint1.theta", "joint2.theta", "joint1.a", "joint2.a")
    np.testing.assert_allclose(problem.sources.sigma, [DEG, 3 * DEG, 0.01, 0.01], rtol=1e-14)
    # rho sigma_a sigma_b by hand
    assert problem.sources.covariance[2, 3] == pytest.approx(0.8 * 1e-4, rel=1e-14)
    assert problem.sources.correlated
    assert problem.task.clearance == pytest.approx(2e-4, rel=1e-14)
    assert problem.measurement.position == pytest.approx(5e-5, rel=1e-14)
    assert problem.solver.starts == 8


def test_written_texts_are_read_back_as_texts() -> None:
    # what YAML 1.1 and 1.2 take for numbers, booleans, dates, null or syntax when it stands bare
    texts = [
        "1e-3",
        "1_000",
        "on",
        "no",
        "y",
        "true",
        "null",
        "~",
        "12:30",
        "2020-01-01",
        "0x1f",
        "",
        "- a",
        "a: b",
        "°",
    ]
    data = {"texts": texts, "on": {"no": 1e-3, "1": -2.5e20, "b": True, "n": None, "i": 3}}
    assert parse_yaml(dump_yaml(data)).data == data


def test_scalars_of_yaml_1_2() -> None:
    text = "on: off\nyes: 1e-3\nnumbers: [.5, 1., +1.5E+3, 010, 0x1F]\ntexts: [1_000, 12:30, 2020-01-01, 1 deg]\n"
    assert parse_yaml(text).data == {
        "on": "off",
        "yes": 1e-3,
        "numbers": [0.5, 1.0, 1500.0, 10, 31],
        "texts": ["1_000", "12:30", "2020-01-01", "1 deg"],
    }


def test_plain_data_agree_with_pyyaml() -> None:
    # on what both versions of YAML read alike, PyYAML's own constructor is the judge
    text = "a: &x {b: [1, 2.5, text, 'quoted', \"two\\nlines\"], c: true}\nd: *x\ne: {<<: *x, c: null}\n"
    text += "f: |\n  block\n  text\n"
    assert parse_yaml(text).data == yaml.safe_load(text)


def test_covariance_file_in_any_order_and_mixed_units(tmp_path: Path) -> None:
    table = "name, joint1.theta [deg], joint1.a [mm]\n\njoint1.a, 0.2, 4.0\njoint1.theta, 1.0, 0.2\n"
    (tmp_path / "cov.csv").write_text(table)
    problem = po.problem_from_dict({**PLANAR, "uncertainty": {"covariance": "cov.csv"}}, tmp_path)
    assert problem.sources.names == ("joint1.theta", "joint1.a")
    expected = [[DEG**2, 0.2 * DEG * 1e-3], [0.2 * DEG * 1e-3, 4e-6]]
    np.testing.assert_allclose(problem.sources.covariance, expected, rtol=1e-13)
    assert "cov.csv" in problem.notes[0]


def test_json_schema_serialises_and_knows_all_sections() -> None:
    schema = json.loads(json.dumps(json_schema()))
    assert set(schema["properties"]) == {"name", "robot", "uncertainty", "cell", "task", "effects", "solver", "data"}
    assert schema["additionalProperties"] is False


@pytest.mark.parametrize("path", sorted(PROBLEMS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_problem_file_loads_and_comes_back(path: Path) -> None:
    problem = po.load_problem(path)
    assert path.stem in builtin_names()
    assert problem.name != path.stem, "it says what it is"
    assert not problem.sources.empty
    again = po.problem_from_dict(parse_yaml(problem.to_yaml()).data, problem.folder)
    assert parse_spec(ProblemDocument(again.to_dict())) == parse_spec(ProblemDocument(problem.to_dict()))
    assert (again.task, again.solver, again.effects) == (problem.task, problem.solver, problem.effects)
    np.testing.assert_array_equal(again.sources.covariance, problem.sources.covariance)


@pytest.mark.parametrize(
    ("uncertainty", "note"),
    [
        ("repeatability: 50 mm", "repeatability 50 mm is 1000 times the data sheet's 0.05 mm"),
        ("repeatability: 0.05 um", "repeatability 5e-05 mm is 1/1000 of the data sheet's 0.05 mm"),
        ("repeatability: 0.5 mm", ""),
        ("sigma: {elbow.theta: 5 deg, elbow.a: 5 m}", "deviation of elbow.theta, 5 deg, is 4800 times"),
        ("sigma: {elbow.theta: 0.01 deg}", ""),
        ("sigma: {elbow.theta: 0 deg}", ""),
        ("sigma: {elbow.theta: 1 urad, wrist_1.theta: 1e-3 urad}", "wrist_1.theta, 1e-3 urad, is 1/18000 of"),
    ],
)
def test_scatter_far_off_the_data_sheet_is_remarked_on(uncertainty: str, note: str) -> None:
    # UR10e: RP 0.05 mm, which leaves each joint 0.0183 mrad = 0.00105 deg
    text = f"robot: {{kind: preset, name: ur10e}}\nuncertainty: {{{uncertainty}}}\n"
    found = [n for n in po.problem_from_dict(parse_yaml(text).data).notes if "right?" in n]
    assert len(found) == bool(note)
    assert all(note in n for n in found)


# --- What other programs write in place of zero, −2.09e-37, is zero wherever a number is read -------------------------

TINY = "-2.09e-37"
PROBLEM = """
robot:
  kind: dh
  base: {{xyz: [{0} m, 0.2 m, {0}], rpy: [{0} rad, {0} deg, 0.3 rad]}}
  tool: {{xyz: [{0} m, 0 m, 0 m], rpy: [0 rad, {0} rad, 0 rad]}}
  joints:
    - {{name: "0", type: revolute, a: 1 m, alpha: {0} rad, d: {0} m, theta: {0} rad, limits: [{0} rad, 170 deg]}}
    - {{name: joint2, type: revolute, a: 0.8 m, alpha: {0}, limits: [-170 deg, 170 deg], com: [{0} m, 0 m, 0 m]}}
uncertainty:
  sigma: {{"0.theta": 1 mrad, joint2.theta: 0.5 mrad, joint2.d: {0} m}}
task:
  kind: insert
  direction: [{0}, -1, {0}]
  position: [0.9 m, 0.9 m, {0} m]
  tilt: {0} rad
  subject_to:
    - {{kind: near_posture, posture: {{"0": {0}}}, at_most: 100 deg}}
"""
URDF = """<robot name="a"><link name="base"/><link name="tip"/>
<joint name="j" type="revolute"><parent link="base"/><child link="tip"/><origin xyz="{0} 0.1 0" rpy="0 {0} 0"/>
<axis xyz="{0} 0 1"/><limit lower="{0}" upper="2"/></joint></robot>"""


def test_a_file_says_what_it_says_with_zeros(tmp_path: Path) -> None:
    (tmp_path / "tiny.yaml").write_text(PROBLEM.format(TINY))
    (tmp_path / "zero.yaml").write_text(PROBLEM.format("0"))
    tiny, zero = (po.load_problem(tmp_path / f"{name}.yaml") for name in ("tiny", "zero"))
    assert tiny.robot == zero.robot
    np.testing.assert_array_equal(tiny.sources.covariance, zero.sources.covariance)
    assert tiny.task == zero.task
    assert po.select_posture(tiny).sigma_max == po.select_posture(zero).sigma_max


def test_a_urdf_says_what_it_says_with_zeros(tmp_path: Path) -> None:
    robots = []
    for name, text in (("tiny", TINY), ("zero", "0")):
        (tmp_path / f"{name}.urdf").write_text(URDF.format(text))
        robots.append(po.problem_from_dict(
            {"robot": {"kind": "urdf", "file": f"{name}.urdf"}, "uncertainty": {"sigma": {"j.theta": "1 mrad"}}},
            folder=tmp_path,
        ).robot)  # fmt: skip
    assert robots[0].factors == robots[1].factors
    assert robots[0].lower == robots[1].lower == (0.0,)


# --- A problem file with other values: read again it says them, and every comment is where it was ---------------------

CELL = (PROBLEMS / "insert_ur10_cell.yaml").read_text(encoding="utf-8")


def comments(text: str) -> list[str]:
    return [line.split("#", 1)[1] for line in text.splitlines() if "#" in line]


@pytest.mark.parametrize(
    "changes",
    [
        {"task__position": ["500.0 mm", "1.0 mm", "0.0 mm"], "task__clearance": "0.1 mm"},
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
