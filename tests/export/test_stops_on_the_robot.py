"""What a program does on the robot: the way in and out of each stop, axes of the controller, load and speed."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.export.export_files import program_files
from posture_opt.export.robot_program import MotionRequest
from tests.export.programs import READERS, answer_program

TOOL = {"xyz": ["0 m", "0 m", "120 mm"]}
UR10 = {"kind": "preset", "name": "ur10", "tool": TOOL}


def answered(**sections: Any) -> tuple[Any, Any]:
    """A problem and its answer."""
    problem = po.problem_from_dict({"uncertainty": {"repeatability": "0.05 mm"}, **sections})
    return problem, po.select_posture(problem)


def test_each_feature_is_entered_and_left_along_its_own_direction() -> None:
    """A hole in the side of a block is left sideways: the direction of the task is that of the hole on top."""
    features = [
        {"name": "top", "position": ["0 m", "0 m", "100 mm"]},
        {"name": "left", "position": ["0 m", "100 mm", "0 m"], "direction": [0, -1, 0]},
    ]
    place = {"x": "0.7 m", "y": "0 m", "z": "0.4 m", "yaw": "0 deg"}
    task = {"kind": "insert", "direction": [0, 0, -1], "workpiece": place, "features": features}
    problem, answer = answered(robot=UR10, task=task)
    files = dict(program_files(answer_program(problem, answer, MotionRequest(approach=0.08)), "urscript", "").files)
    stops = np.array(READERS["urscript"](files, ["revolute"] * 6))
    tool = np.array([np.asarray(problem.arm.position(q), dtype=float) for q in stops])
    (text,) = files.values()
    names = re.findall(r"# approach of (\w+)", text)
    away = {"top": [0, 0, 0.08], "left": [0, 0.08, 0]}
    for k, name in enumerate(names):
        front, stop, behind = tool[3 * k : 3 * k + 3]
        np.testing.assert_allclose(front - stop, away[name], atol=2e-5)
        np.testing.assert_allclose(behind - stop, away[name], atol=2e-5)


RAIL = [
    {"name": "rail", "type": "prismatic", "limits": ["0 m", "2 m"]},
    {"name": "a1", "a": "25 mm", "alpha": "-90 deg", "d": "400 mm"}, {"name": "a2", "a": "455 mm"},
    {"name": "a3", "a": "35 mm", "alpha": "-90 deg", "theta": "-90 deg"},
    {"name": "a4", "alpha": "90 deg", "d": "420 mm"}, {"name": "a5", "alpha": "-90 deg"}, {"name": "a6", "d": "80 mm"},
]  # fmt: skip


def test_a_rail_in_front_of_six_axes_is_an_external_one() -> None:
    base = {"xyz": ["0 m", "0 m", "0.5 m"], "rpy": ["0 deg", "90 deg", "0 deg"]}
    task = {"kind": "insert", "position": ["1.2 m", "0.3 m", "0.4 m"]}
    problem, answer = answered(robot={"kind": "dh", "joints": RAIL, "base": base, "tool": TOOL}, task=task)
    written = {
        "krl": r"A1 ([-\d.]+), .*A6 ([-\d.]+), E1 ([-\d.]+)",
        "rapid": r"\[\[([-\d.]+), .*?, ([-\d.]+)\], \[([-\d.]+), ",
    }
    for kind, axes in written.items():
        exported = program_files(answer_program(problem, answer, MotionRequest(approach=0.0)), kind, "")
        found = re.search(axes, "".join(dict(exported.files).values()))
        assert found is not None
        first, last, rail = map(float, found.groups())
        assert np.radians([first, last]) == pytest.approx(answer.q[[1, 6]], abs=1e-5)
        assert rail == pytest.approx(1e3 * answer.q[0], abs=1e-2)
        assert any("External axes, in this order: rail." in note for note in exported.notes)


@pytest.mark.long
def test_the_load_is_that_of_the_task_and_plunges_are_slow() -> None:
    task = {"kind": "insert", "position": ["0.6 m", "0.2 m", "0.2 m"], "payload": "5 kg"}
    problem, answer = answered(robot=UR10, task=task)
    program = answer_program(problem, answer, MotionRequest(approach=0.05))
    text = "".join(dict(program_files(program, "rapid", "").files).values())
    assert re.search(r"tooldata posture_tool := \[TRUE, \[\[.*\]\], \[5, ", text)
    seam = {"kind": "weld", "points": [["0.6 m", f"{y} m", "0.2 m"] for y in (0.0, 0.2)], "speed": "200 mm/s"}
    problem, answer = answered(robot=UR10, task=seam, solver={"starts": 1, "seed": 0})
    (script,) = dict(program_files(answer_program(problem, answer), "urscript", "").files).values()
    speeds = [float(v) for v in re.findall(r"movel\(.*?v=([\d.]+)", script)]
    assert speeds[0] == speeds[-1] == 0.025
    assert set(speeds[1:-1]) == {0.2}
    assert "a=1.2, v=0.2" in script  # 17 mm to come to speed; with a tenth of it the whole seam is too short
    message = program_files(answer_program(problem, answer, MotionRequest(speed=1.0)), "jointstate", "")
    assert "The first stop has 50 s from wherever the arm is" in "".join(dict(message.files).values())
