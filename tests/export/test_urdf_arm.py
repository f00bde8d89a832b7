"""The exported URDF, read by Pinocchio: corrected to 1e-9 m, and as it was where nothing is corrected."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest

import posture_opt as po
from tests.helpers.capsules import in_the_world
from tests.helpers.pin import robots_folder

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
    **{name: {"kind": "preset", "name": name} for name in ("scara", "kr6_r900", "panda")},
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


ARM = """<?xml version="1.0"?>
<robot name="own" xmlns:xacro="http://ros.org/xacro">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="world"/>
  <joint name="foot" type="fixed"><origin xyz="0.1 0.2 0.3" rpy="0 0 0.4"/><parent link="world"/><child link="base"/></joint>
  <link name="base"><visual><geometry><mesh filename="package://own/base.dae" scale="1e-3 1e-3 1e-3"/></geometry></visual></link>
  <link name="tool">
    <inertial><origin xyz="0.1 0 0" rpy="0 0.1 0"/><mass value="3.5"/>
      <inertia ixx="0.04" ixy="0.001" ixz="0" iyy="0.05" iyz="0.002" izz="0.03"/></inertial>
    <visual><geometry><mesh filename="package://own/arm.dae"/></geometry><material name="grey"/></visual>
    <collision><geometry><box size="0.1 0.1 0.4"/></geometry></collision>
  </link>
  <link name="hand"><inertial><mass value="0.7"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>
  <link name="jaw"><inertial><mass value="0.05"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial></link>
  <joint name="lift" type="prismatic"><origin xyz="0 0 0.2" rpy="0.1 0.2 0.3"/><parent link="base"/><child link="tool"/>
    <axis xyz="0 1 1"/><limit lower="0" upper="0.5" effort="400" velocity="0.25"/></joint>
  <joint name="turn" type="revolute"><origin xyz="0.4 0 0"/><parent link="tool"/><child link="hand"/>
    <axis xyz="1 2 3"/><limit lower="-2" upper="1.5" effort="150" velocity="3.15"/><dynamics damping="0.2"/></joint>
  <joint name="jaw_joint" type="prismatic"><origin xyz="0 0 0.1"/><parent link="hand"/><child link="jaw"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.1"/></joint>
  <transmission name="t"><joint name="turn"/></transmission>
  <gazebo reference="tool"><selfCollide>true</selfCollide></gazebo>
</robot>
"""  # noqa: E501


def exported(folder: Path, **keys: Any) -> tuple[Any, str]:
    """The problem of the arm, and its URDF."""
    (folder / "arm.urdf").write_text(ARM, encoding="utf-8")
    problem = po.problem_from_dict(
        {"robot": {"kind": "urdf", "file": "arm.urdf", "shape": {"replace": []}, **keys}}, folder
    )
    return problem, po.export_files(problem, "urdf").files["arm.urdf"]


def test_what_no_correction_touches_is_as_it_was(tmp_path: Path) -> None:
    _, text = exported(tmp_path, base_link="base")
    before, after = ET.fromstring(ARM), ET.fromstring(text)

    def parts(root: ET.Element, tag: str) -> dict[str, list[str]]:
        found = {}
        for element in root.iter(tag):
            name = element.get("name", element.get("reference", "")).replace("tool_", "tool")
            found[name] = [ET.canonicalize(ET.tostring(e, encoding="unicode"), strip_text=True) for e in element]
        return found

    for tag in ("link", "joint", "transmission", "material", "gazebo"):
        old, new = parts(before, tag), parts(after, tag)
        old.pop("foot", None)
        for name, inside in old.items():
            kept = [text.replace('"tool_"', '"tool"') for text in new[name]]
            assert kept == inside or name == "tool", (tag, name)
    assert [e.tag for e in after.findall("./link[@name='tool_']/*")] == ["inertial", "visual", "collision"]
    (limit,) = after.findall("./joint[@name='turn']/limit")
    assert limit.attrib == {"lower": "-2", "upper": "1.5", "effort": "150", "velocity": "3.15"}


CORRECTED = {
    "base": {"xyz": ["0.3 m", "0 m", "1 m"], "rpy": ["10 deg", "0 deg", "-40 deg"]},
    "tool": {"xyz": ["0 m", "20 mm", "0.1 m"], "rpy": ["5 deg", "0 deg", "0 deg"]},
    "corrections": {"lift.d": "2 mm", "lift.x": "-1 mm", "turn.theta": "0.5 deg", "turn.yaw": "0.2 deg"},
    "velocity": {"turn": "90 deg/s"},
}


@pytest.mark.parametrize(("base_link", "tip_link"), [("world", "hand"), ("base", "tool"), ("base", "jaw")])
def test_the_corrected_arm_keeps_its_inertias_in_pinocchio(tmp_path: Path, base_link: str, tip_link: str) -> None:
    keys: dict[str, Any] = dict(CORRECTED)
    if tip_link == "tool":  # one joint, and a link in the file that is called as the tool frame is
        keys = {**keys, "corrections": {"lift.d": "2 mm", "lift.x": "-1 mm"}, "velocity": {}}
    problem, text = exported(tmp_path, base_link=base_link, tip_link=tip_link, **keys)
    model, plain = pinocchio.buildModelFromXML(text), pinocchio.buildModelFromXML(ARM)
    assert model.frames[1].name == "world"
    names = problem.robot.joint_names
    index = [model.joints[model.getJointId(name)].idx_q for name in names]
    data = model.createData()
    for q in np.random.default_rng(2).uniform(problem.robot.lower, problem.robot.upper, (5, len(names))):
        every = pinocchio.neutral(model)
        every[index] = q
        pinocchio.framesForwardKinematics(model, data, every)
        T = data.oMf[model.getFrameId("tool")].homogeneous
        assert np.abs(T - np.asarray(po.Arm(problem.robot).pose(q))).max() < 1e-9
    for name in ("lift", "turn", "jaw_joint"):
        k, other = model.getJointId(name), plain.getJointId(name)
        assert model.inertias[k].isApprox(plain.inertias[other], 1e-12)
        v, w = model.joints[k].idx_v, plain.joints[other].idx_v
        assert model.effortLimit[v] == plain.effortLimit[w]
        wanted = np.pi / 2 if name == "turn" and "turn" in names else plain.velocityLimit[w]
        assert model.velocityLimit[v] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("file", ["ur_description/urdf/ur10_robot.urdf", "panda_description/urdf/panda.urdf"])
def test_a_published_arm_comes_back(file: str) -> None:
    path = robots_folder() / file
    problem = po.problem_from_dict({"robot": {"kind": "urdf", "file": str(path), "shape": {"replace": []}}})
    text = po.export_files(problem, "urdf").files["arm.urdf"]
    model, plain = pinocchio.buildModelFromXML(text), pinocchio.buildModelFromUrdf(str(path))
    assert list(model.names) == list(plain.names)
    for there, here in zip(model.inertias, plain.inertias, strict=True):
        assert there.isApprox(here, 1e-12)
    for key in ("effortLimit", "velocityLimit", "lowerPositionLimit", "upperPositionLimit"):
        np.testing.assert_array_equal(getattr(model, key), getattr(plain, key))
    for a, b in zip(model.jointPlacements, plain.jointPlacements, strict=True):
        assert a.isApprox(b, 1e-12)
    assert text.count("package://") == path.read_text(encoding="utf-8").count("package://")


def test_efforts_bound_the_torque_and_velocities_the_speed(tmp_path: Path) -> None:
    problem, _ = exported(tmp_path, base_link="base", **{k: v for k, v in CORRECTED.items() if k != "velocity"})
    turn = problem.robot.joints[1]
    assert (turn.effort, turn.velocity) == (150.0, 3.15)
    task = {"kind": "hold", "direction": [0, 0, -1], "subject_to": [{"kind": "joint_torque"}]}
    document = {**problem.to_dict(), "task": task}
    bounded = po.problem_from_dict(document, tmp_path)
    assert bounded.task.subject_to[0].at_most == {"turn": 150.0}
    assert bounded.with_task("hold").task.subject_to[0].at_most == {"turn": 150.0}
    assert "at_most" not in bounded.to_dict()["task"]["subject_to"][0]
    arm = {"kind": "preset", "name": "ur10"}
    with pytest.raises(po.errors.InputError, match="joint_torque states no bound"):
        po.select_posture(
            po.problem_from_dict({"robot": arm, "task": {**task, "position": ["0.6 m", "0.2 m", "0.3 m"]}})
        )
