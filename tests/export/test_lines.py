"""Paths in robot programs: lines at the stated speed between the planned postures, the way in and out, tool data."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import Any

import numpy as np
import pytest
import yaml

import posture_opt as po
from posture_opt.export.export_files import program_files
from posture_opt.export.robot_program import MotionRequest
from tests.export.programs import READERS, answer_program

TOOL = {"xyz": ["10 mm", "0 m", "0.12 m"], "rpy": ["0 deg", "20 deg", "30 deg"]}
POINTS = [["0.6 m", f"{y} m", "0.2 m"] for y in (-0.1, 0.0, 0.002, 0.1)]
SPEED = 0.02


@cache
def seam() -> tuple[Any, Any]:
    """A seam of 200 mm and its answer."""
    task = {"kind": "weld", "points": POINTS, "direction": [0, 0, -1], "speed": "20 mm/s", "spacing": "9 m"}
    problem = po.problem_from_dict({
        "robot": {"kind": "preset", "name": "ur10e", "tool": TOOL, "payload": "2 kg"},
        "uncertainty": {"repeatability": "0.05 mm"}, "task": task, "solver": {"starts": 1, "seed": 0},
    })  # fmt: skip
    return problem, po.select_posture(problem)


@cache
def written(kind: str, **motion: Any) -> dict[str, str]:
    problem, answer = seam()
    return dict(program_files(answer_program(problem, answer, MotionRequest(**motion)), kind, "").files)


@pytest.mark.parametrize("kind", READERS)
def test_a_path_is_followed_from_in_front_of_it_to_behind(kind: str) -> None:
    problem, answer = seam()
    stops = np.array(READERS[kind](written(kind), ["revolute"] * 6))
    assert np.abs(stops[1:-1] - answer.postures).max() < 1e-6
    poses = [np.asarray(problem.arm.pose(q)) for q in stops]
    for way, point in ((poses[0], poses[1]), (poses[-1], poses[-2])):
        np.testing.assert_allclose(way[:3, 3] - point[:3, 3], [0, 0, 0.05], atol=2e-6)
        np.testing.assert_allclose(way[:3, :3], point[:3, :3], atol=1e-5)
    bare = np.array(READERS[kind](written(kind, approach=0.0), ["revolute"] * 6))
    assert np.abs(bare - answer.postures).max() < 1e-6


LINES = {
    "urscript": (r"movel\(\[.*\], a=[\d.]+, v=([\d.]+)(?:, r=[\d.]+)?\)", SPEED),
    "krl": (r"\$VEL\.CP=([\d.]+)", SPEED),
    "rapid": (r"speeddata posture_v := \[([\d.]+), 500, 5000, 1000\]", 1e3 * SPEED),
}
MOVES = {"urscript": ("movel(", "movej("), "krl": ("LIN ", "PTP XP"), "rapid": ("MoveL ", "MoveAbsJ ")}


@pytest.mark.parametrize("kind", LINES)
def test_lines_have_the_speed_of_the_task_whatever_the_joints_have(kind: str) -> None:
    for speed in (10.0, 50.0):
        text = "".join(written(kind, speed=speed).values())
        assert {float(v) for v in re.findall(LINES[kind][0], text)} == {LINES[kind][1]}
        line, joints = MOVES[kind]
        assert (text.count(line), text.count(joints)) == (len(seam()[1].postures) + 1, 1)
    corners = "".join(written(kind).values())
    stopping = "".join(written(kind, wait=1.0).values())
    rounded = {"urscript": ", r=", "krl": "C_DIS", "rapid": ", z0,"}[kind]
    assert rounded in corners
    assert rounded not in stopping


def test_the_tool_data_is_that_of_the_problem() -> None:
    (pitch, yaw), (x, y, z) = np.radians((20, 30)), (0.01, 0.0, 0.12)
    Ry = np.array([[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]])
    Rz = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
    R = Rz @ Ry
    krl = written("krl")["posture.src"]
    frame = dict(re.findall(r"([XYZABC]) (-?[\d.]+)", re.search(r"\$TOOL=\{(.*)\}", krl)[1]))  # type: ignore[index]
    assert [float(v) for v in frame.values()] == pytest.approx([10, 0, 120, 30, 20, 0], abs=1e-5)
    (tcp,) = re.findall(r"set_tcp\(p\[(.*)\]\)", written("urscript")["posture.script"])
    px, py, pz, *turn = map(float, tcp.split(","))
    assert (px, py, pz) == pytest.approx((x, y, z))
    angle, axis = np.linalg.norm(turn), np.array(turn) / np.linalg.norm(turn)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    np.testing.assert_allclose(np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K, R, atol=1e-8)
    data = re.search(r"tooldata posture_tool := (.*);", written("rapid")["posture.mod"])[1]  # type: ignore[index]
    held, ((tx, ty, tz), (w, a, b, c)), (mass, *_) = yaml.safe_load(data.replace("TRUE", "true"))
    assert held is True
    assert ([tx, ty, tz], mass) == (pytest.approx([10, 0, 120]), 2)
    quaternion = np.array(
        [[1 - 2 * (b * b + c * c), 2 * (a * b - w * c)], [2 * (a * b + w * c), 1 - 2 * (a * a + c * c)]]
    )
    np.testing.assert_allclose(quaternion, R[:2, :2], atol=1e-8)


@pytest.mark.parametrize(("robot", "kind", "warned"), [
    ("ur10e", "krl", "KUKA"), ("ur10e", "rapid", "ABB"), ("ur10e", "jointstate", ""), ("kr6_r900", "krl", ""),
    ("irb120", "urscript", "Universal Robots"), ("planar_2r", "krl", ""),
])  # fmt: skip
def test_another_makers_arm_is_noticed(robot: str, kind: str, warned: str) -> None:
    problem = po.problem_from_dict({"robot": {"kind": "preset", "name": robot}})
    found = po.export_files(problem, kind, posture=[0.1] * problem.robot.n)
    notes = [note for note in found.notes if "controllers of" in note]
    assert len(notes) == bool(warned)
    assert not warned or f"this is a program for controllers of {warned}." in notes[0]
    assert not warned or notes[0] in "".join(found.files.values())
