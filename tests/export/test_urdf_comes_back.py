"""A URDF comes back from ``export --to urdf`` as it was, but for the corrections; held against Pinocchio."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest

import posture_opt as po
from tests.helpers.pin import robots_folder

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


@pytest.mark.parametrize("base_link", ["world", "base"])
@pytest.mark.parametrize("tip_link", ["hand", "tool", "jaw"])
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
