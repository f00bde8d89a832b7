"""What other programs write in place of zero, −2.09e-37, is zero wherever a number is read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from tests.helpers.command_line import invoke

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


@pytest.mark.parametrize("numbers", [[0, TINY, 0], [0.0, -2.09e-37, 0.0]])
def test_a_direction_of_rounding_is_none(numbers: list[object]) -> None:
    document = po.load_problem("insert_planar_2r").to_dict()
    with pytest.raises(po.errors.InputError, match=r"task\.direction"):
        po.problem_from_dict(document | {"task": document["task"] | {"direction": numbers}})


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


def test_a_variance_of_rounding_is_none(tmp_path: Path) -> None:
    """Of a parameter without error, −2e-37; what is small beside large ones stays: 10 nm are 1e-16 m²."""
    rows = ["name, joint1.theta [rad], joint2.theta [rad], joint1.a [m]"]
    rows += ["joint1.theta, 1e-6, -3e-37, 2e-12", f"joint2.theta, -3e-37, {TINY}, 0", "joint1.a, 2e-12, 0, 1e-16"]
    (tmp_path / "c.csv").write_text("\n".join(rows))
    document = po.load_problem("insert_planar_2r").to_dict()
    found = po.problem_from_dict(
        document | {"uncertainty": {"covariance": "c.csv"}}, folder=tmp_path
    ).sources.covariance
    np.testing.assert_allclose(found, [[1e-6, 0, 2e-12], [0, 0, 0], [2e-12, 0, 1e-16]], rtol=1e-12, atol=0)


def test_the_command_line_reads_it_too() -> None:
    words = ("--task", "insert", "--json", "--position")
    tiny, zero = (json.loads(invoke(*words, f"0.9 m, 0.9 m, {z}").stdout) for z in (f"{TINY} m", "0"))
    assert tiny["sigma_max"] == zero["sigma_max"]
    assert tiny["posture"] == zero["posture"]
