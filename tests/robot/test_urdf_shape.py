"""Shapes of URDF arms: capsules about ``<collision>`` elements, which Pinocchio places and coal describes."""

from __future__ import annotations

import math
from pathlib import Path

import coal
import numpy as np
import pinocchio
import pytest

import posture_opt as po
from posture_opt.robot import UrdfRobot
from tests.helpers.capsules import from_segment, in_the_world
from tests.helpers.factors import random_postures
from tests.helpers.pin import PinArm, robots_folder

BODIES = """<robot name="two">
  <link name="foot"><collision><origin xyz="0 0 0.05"/><geometry><box size="0.3 0.2 0.1"/></geometry></collision></link>
  <link name="stand"><collision><geometry><sphere radius="0.07"/></geometry></collision></link>
  <link name="arm">
    <collision><origin xyz="0.2 0 0" rpy="0 1.5708 0"/>
      <geometry><cylinder radius="0.04" length="0.4"/></geometry></collision>
    <collision><origin xyz="0.4 0.02 0" rpy="0.3 0 0.1"/><geometry><box size="0.02 0.3 0.2"/></geometry></collision>
  </link>
  <link name="slide"><collision><origin xyz="0 0 -0.1"/>
    <geometry><cylinder radius="0.02" length="0.3"/></geometry></collision></link>
  <link name="tip"/>
  <link name="gripper"><collision><geometry><box size="0.1 0.05 0.05"/></geometry></collision></link>
  <link name="finger"><collision><geometry><box size="0.1 0.01 0.01"/></geometry></collision></link>
  <joint name="f1" type="fixed"><origin xyz="0 0 0.3"/><parent link="foot"/><child link="stand"/></joint>
  <joint name="turn" type="revolute"><origin xyz="0 0 0.1" rpy="0.2 0.1 0"/><parent link="stand"/><child link="arm"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="lift" type="prismatic"><origin xyz="0.4 0 0"/><parent link="arm"/><child link="slide"/>
    <axis xyz="0 0 1"/><limit lower="-0.1" upper="0.2" effort="1" velocity="1"/></joint>
  <joint name="f2" type="fixed"><origin xyz="0.1 0 0.2" rpy="0 0.5 0"/><parent link="slide"/><child link="tip"/></joint>
  <joint name="f3" type="fixed"><origin xyz="0 0 0.1"/><parent link="tip"/><child link="gripper"/></joint>
  <joint name="f4" type="prismatic"><origin xyz="0.1 0 0"/><parent link="gripper"/><child link="finger"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.1" effort="1" velocity="1"/></joint>
</robot>
"""
OWNER = {"foot": "base", "stand": "base", "arm": "turn", "slide": "lift", "gripper": "lift"}


def built(tmp_path: Path, text: str, **keys) -> po.Robot:
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    return UrdfRobot(file="arm.urdf", tip_link="tip", **keys).build(tmp_path)


def surface(shape) -> np.ndarray:
    """(k, 3) points of the surface of one of coal's bodies that its hull needs."""
    if isinstance(shape, coal.Sphere):
        directions = np.random.default_rng(0).normal(size=(500, 3))
        return shape.radius * directions / np.linalg.norm(directions, axis=1)[:, None]
    if isinstance(shape, coal.Cylinder):
        turn = np.linspace(0, 2 * np.pi, 200)
        rim = np.column_stack([np.cos(turn), np.sin(turn)]) * shape.radius
        return np.vstack([np.column_stack([rim, np.full(200, z)]) for z in (-shape.halfLength, shape.halfLength)])
    if isinstance(shape, coal.Box):
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        return signs * np.array(shape.halfSide).ravel()
    return np.array(shape.vertices())


@pytest.mark.filterwarnings("ignore:Please update your 'hppfcl' imports:DeprecationWarning")
def outside(robot: po.Robot, arm: PinArm, file: Path, owner, base: str, rename=str, scale=1.0) -> float:
    """How far any collision body sticks out of the capsules of its joint [m], at random postures."""
    geometry = pinocchio.buildGeomFromUrdf(
        arm.model, str(file), pinocchio.GeometryType.COLLISION, package_dirs=[str(robots_folder().parents[1])]
    )
    worst = -np.inf
    for q in random_postures(robot, 3):
        named = {rename(joint): value for joint, value in zip(robot.joint_names, q, strict=True)}
        configuration = arm.configuration(named)
        pinocchio.framesForwardKinematics(arm.model, arm.data, configuration)
        T_base_world = arm.data.oMf[arm.model.getFrameId(base)].inverse()
        for body in geometry.geometryObjects:
            joint = owner.get(arm.model.frames[body.parentFrame].name)
            if joint is not None:
                T = T_base_world * arm.data.oMi[body.parentJoint] * body.placement
                points = surface(body.geometry) * np.where(np.isfinite(body.meshScale), body.meshScale, 1.0)
                world = np.array([T.act(point) for point in points])
                capsules = [in_the_world(robot, q, capsule) for capsule in robot.shape if capsule.joint == joint]
                apart = np.min([from_segment(world, a, b) - radius for a, b, radius in capsules], axis=0)
                worst = max(worst, float(apart.max()))
    return worst


@pytest.mark.filterwarnings("ignore:Please update your 'hppfcl' imports:DeprecationWarning")
def test_capsules_contain_boxes_cylinders_and_spheres(tmp_path: Path) -> None:
    robot = built(tmp_path, BODIES)
    assert {capsule.joint for capsule in robot.shape} == {"base", "turn", "lift"}
    assert outside(robot, PinArm(BODIES), tmp_path / "arm.urdf", OWNER, "foot") < 1e-8
    assert robot.shape_notes == ("not in the shape, as they move apart from the chain: finger",)


def test_capsules_of_a_self_collision_model_are_taken_as_they_are() -> None:
    """A cylinder between two balls of its radius: the description of the Panda's controller."""
    file = robots_folder() / "panda_description/urdf/panda_collision.urdf"
    robot = UrdfRobot(file=str(file), tip_link="panda_link8").build(Path())
    first = [capsule for capsule in robot.shape if capsule.joint == "panda_joint1"]
    assert len(first) == 1
    assert np.allclose(sorted([first[0].start, first[0].end]), [[0, 0, -0.333], [0, 0, -0.05]], atol=1e-9)
    assert first[0].radius == 0.09


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:Please update your 'hppfcl' imports:DeprecationWarning")
def test_capsules_contain_meshes() -> None:
    pytest.importorskip("trimesh")
    file = robots_folder() / "ur_description/urdf/ur5_robot.urdf"
    robot = UrdfRobot(file=str(file), tip_link="tool0").build(Path())
    joints = ["base", *robot.joint_names]
    links = [
        "base_link",
        *(f"{name}_link" for name in ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")),
    ]
    owner = dict(zip(links, joints, strict=True)) | {"ee_link": joints[-1]}
    assert outside(robot, PinArm(file), file, owner, "base_link") < 1e-6  # meshes are stored in single precision
    assert robot.shape_notes == ()


MESH = """<robot name="m"><link name="foot"/>
  <link name="tip"><collision><geometry><mesh filename="{}" scale="0.5 0.5 0.5"/></geometry></collision></link>
  <joint name="j" type="revolute"><parent link="foot"/><child link="tip"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
CUBE = (
    "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
    + "f 1 2 4\nf 1 3 4\nf 5 6 8\nf 5 7 8\nf 1 2 6\nf 1 5 6\nf 3 4 8\nf 3 7 8\nf 1 3 7\nf 1 5 7\nf 2 4 8\nf 2 6 8\n"
)


@pytest.mark.parametrize(
    "name", ["package://parts/meshes/cube.obj", "../meshes/cube.obj", "package://other_name/meshes/cube.obj"]
)
def test_meshes_of_a_package_are_found(tmp_path: Path, name: str) -> None:
    pytest.importorskip("trimesh")
    folder = tmp_path / "parts"
    (folder / "urdf").mkdir(parents=True)
    (folder / "meshes").mkdir()
    (folder / "package.xml").write_text("<package/>")
    (folder / "meshes" / "cube.obj").write_text(CUBE)
    robot = built(folder / "urdf", MESH.format(name))
    assert robot.shape_notes == ()
    corners = 0.5 * np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    ends = [(np.array(c.start), np.array(c.end), c.radius) for c in robot.shape]
    assert np.min([from_segment(corners, a, b) - r for a, b, r in ends], axis=0).max() < 1e-8
    assert sum(c.radius for c in robot.shape) / len(ends) < 0.5 * math.sqrt(3)


@pytest.mark.parametrize("name", ["package://parts/meshes/a &amp; b.obj", "meshes/a &amp; b.obj"])
def test_a_problem_that_is_saved_elsewhere_keeps_the_shape(tmp_path: Path, name: str) -> None:
    pytest.importorskip("trimesh")
    parts, saved = tmp_path / "parts", tmp_path / "out" / "saved"
    for folder in (parts / "meshes", saved):
        folder.mkdir(parents=True)
    (parts / "meshes" / "a & b.obj").write_text(CUBE)
    (parts / "arm.urdf").write_text(MESH.format(name))
    document = "robot: {kind: urdf, file: arm.urdf, tip_link: tip}\nuncertainty: {sigma: {j.theta: 1 mrad}}\n"
    (parts / "p.yaml").write_text(document)
    problem = po.load_problem(parts / "p.yaml")
    for file, content in problem.files("copy").items():
        (saved / file).write_bytes(content)
    assert problem.robot.shape
    assert po.load_problem(saved / "copy.yaml").robot.shape == problem.robot.shape


def test_a_broken_mesh_is_a_note(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    (tmp_path / "cube.stl").write_bytes(b"no mesh at all")
    robot = built(tmp_path, MESH.format("cube.stl"))
    assert robot.shape == ()
    assert robot.shape_notes[0].startswith("no shape of tip: mesh cube.stl")


def test_numbers_that_are_none_are_refused_with_their_line(tmp_path: Path) -> None:
    with pytest.raises(po.errors.InputError, match=r"arm.urdf:2.*box size") as caught:
        built(tmp_path, BODIES.replace("0.3 0.2 0.1", "0.3 0.2"))
    assert caught.value.issues[0].key == ("file",)


def test_a_stated_shape_is_in_the_child_link_of_the_joint(tmp_path: Path) -> None:
    """The frame behind the last joint is that of the tip; what is stated there is in the link before it."""
    given = {"joint": "lift", "from": ["0 m"] * 3, "to": ["0 m", "0 m", "0.2 m"], "radius": "20 mm"}
    robot = built(tmp_path, BODIES, shape={"replace": [given]})
    arm = PinArm(BODIES)
    for q in random_postures(robot, 3):
        a, b, _ = in_the_world(robot, q, robot.shape[0])
        T = arm.pose(dict(zip(robot.joint_names, q, strict=True)), "foot", "slide")
        np.testing.assert_allclose([a, b], [T[:3, 3], T[:3, 3] + 0.2 * T[:3, 2]], atol=1e-12)
