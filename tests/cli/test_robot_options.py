"""``--tool``, ``--base``, ``--payload``, and ``--robot`` with a problem file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.cli.request import requested_problem
from tests.helpers.command_line import invoke
from tests.helpers.same_problem import written

AT = ("--task", "insert", "--position", "0.6 m, 0.2 m, 0.3 m")


def test_the_frames_of_the_command_line_are_those_of_a_file() -> None:
    stated = {
        "kind": "preset", "name": "ur10", "payload": "1.2 kg",
        "tool": {"xyz": [0, 0, "150 mm"], "rpy": [0, 0, "90 deg"]}, "base": {"xyz": [0, "1 m", 0]},
    }  # fmt: skip
    in_file = po.problem_from_dict({"robot": stated}).robot
    words = {"tool": "0, 0, 150 mm, 0, 0, 90 deg", "base": "0, 1 m, 0", "payload": "1.2 kg"}
    for problem in (requested_problem(None, "ur10", **words), requested_problem("insert_ur10", **words)):
        robot = problem.robot
        assert (robot.tool, robot.base, robot.payload) == (in_file.tool, in_file.base, in_file.payload)
        assert any("tool from the command line: 0, 0, 150 mm, 0, 0, 90 deg" in note for note in problem.notes)


def test_what_a_file_states_is_overridden_and_the_report_says_so() -> None:
    words = ["--problem", "insert_ur10_extended", "--tool", "0, 0, 80 mm", "--payload", "2 kg"]
    result = invoke(*words)
    assert result.exit_code == 0, result.stderr
    assert "Tool from the command line: 0, 0, 80 mm, in place of the file's." in result.stdout
    assert "Payload from the command line: 2 kg, in place of the file" in result.stdout
    problem = requested_problem("insert_ur10_extended", tool="0, 0, 80 mm", payload="2 kg")
    assert problem.robot.payload == problem.arm.inputs.payload == 2
    former = po.load_problem("problems/insert_ur10_extended.yaml")
    assert problem.effects == former.effects
    assert problem.robot.links == former.robot.links


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--tool", "0, 0"), "--tool: 2 entries where 3 or 6 belong"),
        (("--tool", "0, 0, 150"), "--tool.z: the length has no unit (here 150) – write 150 mm or 150 m"),
        (("--base", "0, 0, 1 deg"), "--base.z: 'deg' is not a unit of length"),
        (("--base", "0, 0, 0, 0, 0, 90"), "--base.yaw: the angle has no unit"),
        (("--payload", "2"), "--payload: the mass has no unit"),
        (("--payload", "2 mm"), "--payload: 'mm' is not a unit of mass"),
    ],
)
def test_frames_and_masses_that_are_none_are_refused(words: tuple[str, ...], told: str) -> None:
    for others in (("--problem", "insert_ur10"), ("--robot", "ur10", *AT)):
        result = invoke(*others, *words)
        assert result.exit_code == 2
        assert told in result.stderr


def test_a_calibrated_file_with_its_covariance_beside_it_is_a_robot(tmp_path: Path) -> None:
    problem = po.load_problem("problems/insert_planar_2r_measured.yaml")
    data = po.read_measurements("problems/planar_2r_measured.csv", problem)
    calibrated = po.calibrated_problem(problem, po.calibrate(problem, data, plan=False))
    for name, content in calibrated.files("mine").items():
        (tmp_path / name).write_bytes(content)
    found = requested_problem(None, str(tmp_path / "mine.yaml"), task="insert", position="0.9 m, 0.4 m, 0 m")
    assert found.robot == written(calibrated, tmp_path).robot
    np.testing.assert_allclose(found.sources.covariance, calibrated.sources.covariance, rtol=1e-4)
    assert found.task is not None
    again = invoke("calibrate", "problems/planar_2r_measured.csv", "--robot", tmp_path / "mine.yaml", "--json")
    assert again.exit_code == 0, again.stderr
    assert json.loads(again.stdout)["residual_rms"]["nominal"] < 0.01
