"""The capsules of the presets against the collision meshes of example-robot-data, placed by Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest

from posture_opt.robot import load_preset, preset_names
from tests.helpers.capsules import from_segment, in_the_world
from tests.helpers.factors import random_postures
from tests.helpers.pin import PinArm, robots_folder

UR = ["shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"]
ARMS = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", ["base_link", *(f"{name}_link" for name in UR)]),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", ["base_link", *(f"{name}_link" for name in UR)]),
    "panda": ("panda_description/urdf/panda.urdf", [f"panda_link{i}" for i in range(8)]),
}
OUTSIDE = {  # mm by which a mesh sticks out of its capsules at most, as the presets say; elsewhere not at all
    ("ur5", "base"): 30, ("ur5", "elbow"): 11, ("ur5", "wrist_2"): 5,
    ("ur10", "base"): 37, ("ur10", "elbow"): 9, ("ur10", "wrist_2"): 6,
    ("panda", "panda_joint5"): 7, ("panda", "panda_joint7"): 6,
}  # fmt: skip
BEYOND = 0.095  # m: no point of a capsule is farther from the hull of its mesh; the fattest is the Panda's base
TURNED = np.diag([-1.0, -1.0, 1.0, 1.0])  # ROS base_link against Universal Robots' Base


def meshes(name):
    """(joint of the preset, (k, 3) vertices in the link, link) of each collision mesh."""
    file, links = ARMS[name]
    urdf = robots_folder() / file
    arm = PinArm(urdf)
    folder, kind = str(robots_folder().parents[1]), pinocchio.GeometryType.COLLISION
    geometry = pinocchio.buildGeomFromUrdf(arm.model, str(urdf), kind, package_dirs=[folder])
    robot = load_preset(name)
    for body in geometry.geometryObjects:
        link = arm.model.frames[body.parentFrame].name
        if link in links:
            T_joint_link = arm.model.frames[body.parentFrame].placement
            inside = T_joint_link.inverse() * body.placement
            points = np.array([inside.act(v * body.meshScale) for v in body.geometry.vertices()])
            yield ("base", *robot.joint_names)[links.index(link)], points, link


@pytest.mark.filterwarnings("ignore:Please update your 'hppfcl' imports:DeprecationWarning")
@pytest.mark.parametrize("name", ARMS)
def test_capsules_contain_the_meshes(name):
    robot, arm = load_preset(name), PinArm(robots_folder() / ARMS[name][0])
    turned, base = (TURNED, "base_link") if name != "panda" else (np.eye(4), "panda_link0")
    bodies = list(meshes(name))
    assert {joint for joint, _, _ in bodies} == {"base", *robot.joint_names}
    for q in random_postures(robot, 3):
        names = robot.joint_names if name == "panda" else [f"{joint}_joint" for joint in robot.joint_names]
        named = dict(zip(names, q, strict=True))
        for joint, points, link in bodies:
            T = turned @ arm.pose(named, base, link)
            world = points @ T[:3, :3].T + T[:3, 3]
            capsules = [in_the_world(robot, q, capsule) for capsule in robot.shape if capsule.joint == joint]
            outside = np.min([from_segment(world, a, b) - radius for a, b, radius in capsules], axis=0).max()
            assert outside < OUTSIDE.get((name, joint), 0) * 1e-3
            for a, b, radius in capsules:  # tight: the segment is within the body, so its surface is near
                ends = np.array([a, b])
                near = np.linalg.norm(ends[:, None] - world, axis=2).min(axis=1)
                assert (radius - near).max() < BEYOND


@pytest.mark.parametrize("name", sorted(set(preset_names()) - {"planar_2r"}))
def test_every_machine_has_a_shape_with_its_source(name):
    robot = load_preset(name)
    joints = [capsule.joint for capsule in robot.shape]
    assert "base" in joints
    assert set(joints) <= {"base", *robot.joint_names}
    # the roll of a SCARA's shaft moves nothing that the shaft does not have already
    assert len(set(joints)) >= robot.n
    assert dict(robot.sources)["shape"]
    assert all(0.005 < capsule.radius < 0.5 for capsule in robot.shape)


def test_a_drawing_has_no_shape():
    assert load_preset("planar_2r").shape == ()
