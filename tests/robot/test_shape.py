"""``robot.shape``: what the file states, capsules along the links, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import posture_opt as po
from posture_opt.robot import Capsule, DhRobot, UrdfRobot, load_preset
from posture_opt.robot.shape_section import along_links
from tests.helpers.capsules import from_segment, in_the_world
from tests.helpers.factors import elementary, frame, random_postures
from tests.helpers.pin import BARE, robots_folder
from tests.helpers.same_problem import written

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


def test_stated_capsules_replace_those_of_the_preset(tmp_path):
    problem = with_shape({"replace": [ELBOW, ELBOW | {"joint": "base", "to": ["0 m"] * 3}]})
    assert problem.robot.shape == (
        Capsule("elbow", (0, 0, 0), (0.5, 0, 0), 0.06),
        Capsule("base", (0, 0, 0), (0, 0, 0), 0.06),
    )
    assert "wrist_1" in problem.robot.unshaped
    again = po.problem_from_dict(problem.to_dict())
    assert again.robot.shape == problem.robot.shape == written(problem, tmp_path).robot.shape


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
    ([ELBOW | {"radius": 60}], "robot.shape[0].radius", "has no unit"),
    ([ELBOW | {"from": ["0 m", 1, "0 m"]}], "robot.shape[0].from[1]", "has no unit"),
    ([ELBOW | {"to": ["0 m"]}], "robot.shape[0].to", "1 entry, 3 expected"),
    ([{**ELBOW, "diameter": "1 m"}], "robot.shape[0].diameter", "unknown key"),
    ({"radius": "-1 mm"}, "robot.shape.radius", "must be greater than 0 m"),
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
ARMS = {
    "dh": load_preset("ur10"),
    "mdh": load_preset("panda"),
    "slide": load_preset("scara"),
    "urdf": UrdfRobot(file=str(UR5_URDF), tip_link="tool0", shape=BARE).build(Path()),
}  # fmt: skip


@pytest.mark.parametrize("arm", ARMS)
def test_capsules_lie_along_the_links(arm):
    """All frames that links end at are on the axes of capsules, and the capsules end at frames."""
    robot = ARMS[arm]
    capsules = along_links(robot, 0.05)
    for q in random_postures(robot, 5):
        at = [in_the_world(robot, q, capsule)[:2] for capsule in capsules]
        behind = np.array([frame(robot, q, i)[:3, 3] for i in range(robot.n)])
        assert np.min([from_segment(behind, a, b) for a, b in at], axis=0).max() < ROUNDING
        points = corners(robot, q)
        ends = np.array([end for c, pair in zip(capsules, at, strict=True) if c.joint not in SLIDES for end in pair])
        assert np.linalg.norm(ends[:, None] - points, axis=2).min(axis=1).max() < ROUNDING
