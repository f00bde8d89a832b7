"""The exported URDF, read by Pinocchio: the arm of the program to 1e-9 m, corrections and frames included."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest

import posture_opt as po
from tests.helpers.capsules import in_the_world
from tests.helpers.variants import STRUCTURES

SAME = 1e-9  # m and rad


def dh(kind: str) -> dict[str, Any]:
    """A table with offsets of every joint and a slide in the middle."""
    rng = np.random.default_rng(4)
    rows = []
    for k, slides in enumerate([False, False, True, False, False]):
        theta, alpha = rng.uniform(-3, 3), rng.choice([0, np.pi / 2, -np.pi / 2, 0.3])
        rows.append({
            "name": f"j.{k + 1}", "type": "prismatic" if slides else "revolute", "a": f"{rng.uniform(-1, 1)} m",
            "alpha": f"{alpha} rad", "d": f"{rng.uniform(-1, 1)} m", "theta": f"{theta} rad",
            "limits": ["-50 mm", "300 mm"] if slides else ["-170 deg", "120 deg"],
        })  # fmt: skip
    return {"kind": kind, "joints": rows}


SECTIONS: dict[str, dict[str, Any]] = {
    "dh": dh("dh"),
    "mdh": dh("mdh"),
    **{name: {"kind": "preset", "name": name} for name in STRUCTURES},
}


def corrected(section: dict[str, Any], seed: int, folder: Path = Path()) -> Any:
    """The arm with frames of its own and random errors of every parameter, those of the frames included."""
    rng = np.random.default_rng(seed)
    frame = lambda: {  # noqa: E731
        "xyz": [f"{v} m" for v in rng.uniform(-1, 1, 3)],
        "rpy": [f"{v} rad" for v in rng.uniform(-3, 3, 3)],
    }
    section = {**section, "base": frame(), "tool": frame()}
    robot = po.problem_from_dict({"robot": section}, folder).robot
    units = {name: "rad" if factor.kind == "rotate" else "m" for name, factor in robot.parameters.items()}
    section["corrections"] = {name: f"{rng.normal(0, 0.01)} {unit}" for name, unit in units.items()}
    return po.problem_from_dict({"name": "arm <&>", "robot": section}, folder)


def check(problem: Any, text: str, count: int = 20) -> None:
    """Pinocchio's frames of the file against the program's, and what a controller reads of the joints."""
    model = pinocchio.buildModelFromXML(text)
    data, robot = model.createData(), problem.robot
    assert list(model.names)[1:] == list(robot.joint_names)
    assert model.frames[1].name == "world"
    assert np.allclose(model.lowerPositionLimit, robot.lower)
    assert np.allclose(model.upperPositionLimit, robot.upper)
    low, high = np.maximum(robot.lower, -4), np.minimum(robot.upper, 4)
    for q in np.random.default_rng(1).uniform(low, high, (count, robot.n)):
        pinocchio.framesForwardKinematics(model, data, q)
        T = data.oMf[model.getFrameId("tool")].homogeneous
        assert np.abs(T - np.asarray(po.Arm(robot).pose(q))).max() < SAME


@pytest.mark.parametrize("name", SECTIONS)
def test_the_corrected_arm_stands_where_the_program_says(name: str) -> None:
    problem = corrected(SECTIONS[name], seed=hash_of(name))
    check(problem, po.export_files(problem, "urdf").files["arm.urdf"])


@pytest.mark.parametrize("source", ["insert_urdf_arm", "export"])
def test_so_does_an_arm_that_came_as_urdf(source: str, tmp_path: Path) -> None:
    """That of the repository, with any axes, and an exported one read again: it is the same arm."""
    if source == "insert_urdf_arm":
        problem = po.load_problem(source)
        section = dict(problem.to_dict()["robot"])
        problem = corrected(section, 7, problem.folder)
        check(problem, po.export_files(problem, "urdf").files["arm.urdf"])
        return
    first = corrected(SECTIONS["dh"], 8)
    (tmp_path / "arm.urdf").write_text(po.export_files(first, "urdf").files["arm.urdf"])
    again = po.problem_from_dict({"robot": {"kind": "urdf", "file": "arm.urdf"}}, tmp_path)
    q = np.random.default_rng(0).uniform(first.robot.lower, first.robot.upper, (10, 5))
    assert np.abs(np.asarray(po.Arm(first.robot).pose(q)) - np.asarray(po.Arm(again.robot).pose(q))).max() < SAME


def test_axes_in_any_direction(tmp_path: Path) -> None:
    """Axes against a coordinate axis and askew: zeros and directions are those of the model's joints."""
    joints = "".join(
        f'<link name="l{k + 1}"/><joint name="q{k}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0.1 {k} 0.3" rpy="0.2 {pitch} -0.7"/><axis xyz="{axis}"/>'
        '<limit lower="-1" upper="2" effort="1" velocity="1"/></joint>'
        for k, (kind, axis, pitch) in enumerate([
            ("revolute", "0 0 -1", 0.4), ("revolute", "1 2 -2", 1.5707963267948966), ("prismatic", "0 -1 0", 0),
            ("revolute", "1 0 0", -1.5707963267948966),
        ])
    )  # fmt: skip
    (tmp_path / "odd.urdf").write_text(f'<robot name="odd"><link name="l0"/>{joints}</robot>')
    problem = corrected({"kind": "urdf", "file": "odd.urdf"}, 9, tmp_path)
    check(problem, po.export_files(problem, "urdf").files["arm.urdf"])


def test_the_shape_comes_back_as_the_same_capsules(tmp_path: Path) -> None:
    """Bodies of links, cylinders with balls, are where the program has its capsules."""
    problem = corrected({"kind": "preset", "name": "ur5e"}, 5)
    (tmp_path / "arm.urdf").write_text(po.export_files(problem, "urdf").files["arm.urdf"])
    again = po.problem_from_dict({"robot": {"kind": "urdf", "file": "arm.urdf"}}, tmp_path)
    q = np.array([0.3, -1.2, 1.1, -0.4, 0.8, 0.2])
    ends = []
    for robot in (problem.robot, again.robot):
        moving = [in_the_world(robot, q, c) for c in robot.shape if c.joint in robot.joint_names]
        assert len(moving) > 5
        ends.append(sorted((*end, radius) for *both, radius in moving for end in both))
    assert np.abs(np.array(ends[0], dtype=float) - np.array(ends[1], dtype=float)).max() < 1e-6


def hash_of(name: str) -> int:
    """A seed of a name, the same in every process."""
    return sum(map(ord, name))
