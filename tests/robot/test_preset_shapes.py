"""The capsules of the presets against the collision meshes of example-robot-data, placed by Pinocchio."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio
import pytest

import posture_opt as po
from posture_opt.robot import Capsule, DhRobot, UrdfRobot, preset_names
from posture_opt.robot.shape_section import along_links
from tests.helpers.capsules import from_segment, in_the_world
from tests.helpers.factors import elementary, frame, random_postures
from tests.helpers.pin import BARE, PinArm, robots_folder
from tests.helpers.shipped import preset_robot

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
    robot = preset_robot(name)
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
    robot, arm = preset_robot(name), PinArm(robots_folder() / ARMS[name][0])
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
    robot = preset_robot(name)
    joints = [capsule.joint for capsule in robot.shape]
    assert "base" in joints
    assert set(joints) <= {"base", *robot.joint_names}
    # the roll of a SCARA's shaft moves nothing that the shaft does not have already
    assert len(set(joints)) >= robot.n
    assert dict(robot.sources)["shape"]
    assert all(0.005 < capsule.radius < 0.5 for capsule in robot.shape)


# --- ``robot.shape``: what the file states, capsules along the links, and what is refused -----------------------------

ELBOW = {"joint": "elbow", "from": ["0 m", "0 m", "0 m"], "to": ["0.5 m", "0 m", "0 m"], "radius": "60 mm"}
SLIDES = {"joint3"}
ROUNDING = 1e-9  # what counts as one point in the package


def with_shape(shape, name="ur10"):
    return po.problem_from_dict({"robot": {"kind": "preset", "name": name, "shape": shape}})


def corners(robot, q):
    """(k, 3) origins of all frames from the base to the flange, in the world [m]."""
    T, points = np.eye(4), []
    for k, f in enumerate([*robot.base, *(f for link in robot.links for f in link)]):
        T = T @ elementary(f.kind, f.axis, f.nominal + (0.0 if f.joint is None else q[f.joint]))
        if k + 1 >= len(robot.base):
            points.append(T[:3, 3])
    return np.array(points)


@pytest.mark.parametrize("shape", [[ELBOW], {"add": [ELBOW]}])
def test_capsules_are_added_to_those_of_the_preset(shape):
    own, problem = with_shape(None), with_shape(shape)
    assert problem.robot.shape == (*own.robot.shape, Capsule("elbow", (0, 0, 0), (0.5, 0, 0), 0.06))
    assert bool(problem.robot.shape_notes) == isinstance(shape, list)  # a plain list could have been meant to replace


def test_shape_of_a_table():
    row = {"name": "j", "a": "0.3 m"}
    robot = DhRobot(joints=[row], shape=[ELBOW | {"joint": "tool"}]).build(Path())
    assert robot.shape == (Capsule("tool", (0, 0, 0), (0.5, 0, 0), 0.06),)


@pytest.mark.parametrize(("shape", "key", "message"), [
    ([ELBOW | {"joint": "elbw"}], "robot.shape[0].joint", "did you mean 'elbow'"),
    ([ELBOW, ELBOW | {"radius": "0 mm"}], "robot.shape[1].radius", "must be greater than 0 m, not '0 mm'"),
    ([ELBOW | {"from": ["0 m", 1, "0 m"]}], "robot.shape[0].from[1]", "has no unit"),
    ([ELBOW | {"to": ["0 m"]}], "robot.shape[0].to", "1 entry, 3 expected"),
    ([{**ELBOW, "diameter": "1 m"}], "robot.shape[0].diameter", "unknown key"),
    ({}, "robot.shape", "states nothing"),
    ({"replace": [ELBOW], "radius": "1 mm"}, "robot.shape", "both given"),
    ({"add": [ELBOW, ELBOW | {"joint": "elbw"}]}, "robot.shape.add[1].joint", "did you mean 'elbow'"),
    ("thick", "robot.shape", "is not a list"),
])  # fmt: skip
def test_bad_shapes_are_refused(shape, key, message):
    with pytest.raises(po.errors.InputError, match=message) as caught:
        with_shape(shape)
    assert str(caught.value).startswith(f"{key}: ")


UR5_URDF = robots_folder() / "ur_description/urdf/ur5_robot.urdf"
ARMS_STATED = {
    "dh": preset_robot("ur10"),
    "mdh": preset_robot("panda"),
    "slide": preset_robot("scara"),
    "urdf": UrdfRobot(file=str(UR5_URDF), tip_link="tool0", shape=BARE).build(Path()),
}  # fmt: skip


@pytest.mark.parametrize("arm", ARMS_STATED)
def test_capsules_lie_along_the_links(arm):
    """All frames that links end at are on the axes of capsules, and the capsules end at frames."""
    robot = ARMS_STATED[arm]
    capsules = along_links(robot, 0.05)
    for q in random_postures(robot, 5):
        at = [in_the_world(robot, q, capsule)[:2] for capsule in capsules]
        behind = np.array([frame(robot, q, i)[:3, 3] for i in range(robot.n)])
        assert np.min([from_segment(behind, a, b) for a, b in at], axis=0).max() < ROUNDING
        points = corners(robot, q)
        ends = np.array([end for c, pair in zip(capsules, at, strict=True) if c.joint not in SLIDES for end in pair])
        assert np.linalg.norm(ends[:, None] - points, axis=2).min(axis=1).max() < ROUNDING
