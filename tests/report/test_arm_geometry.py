"""The geometry that pictures and the interactive view draw: in the world, true to scale, beside the moments."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.collision.facets import capsule_facets, tapered_facets
from posture_opt.report.scene.arm_solids import ArmSolids
from tests.helpers.capsules import from_segment
from tests.helpers.shipped import preset_robot


def volume(faces: np.ndarray) -> float:
    """Of a closed surface of flat faces (k, 4, 3), by the divergence theorem; positive with normals outward."""
    a, b, c, d = np.moveaxis(faces, 1, 0)
    return float(np.sum(np.cross(a, b) * c + np.cross(a, c) * d) / 6)


def test_a_tapered_link_is_closed_and_as_large_as_a_cone_between_half_balls():
    found = tapered_facets(np.array([0.1, 0.2, 0.3]), np.array([0.1, 1.2, 0.3]), 0.1, 0.05)
    cone = np.pi / 3 * (0.1**2 + 0.1 * 0.05 + 0.05**2)
    balls = 2 / 3 * np.pi * (0.1**3 + 0.05**3)
    assert abs(volume(found)) == pytest.approx(cone + balls, rel=0.03)  # a polygon of 20 corners is 1.6 % smaller


@pytest.mark.parametrize("preset", ["planar_2r", "scara", "panda"])
def test_joints_stand_on_their_axes(preset):
    robot = preset_robot(preset)
    arm, q = ArmSolids(robot), np.linspace(0.3, -0.4, robot.n)
    frames = arm.frames(q)
    for k, joint in enumerate(arm.joints):
        moved = q.copy()
        moved[k] += 0.2
        world = joint.placed(frames)
        motion = arm.frames(moved)[k + 1] @ np.linalg.inv(frames[k + 1])  # of all that the joint carries
        turned = (motion @ [*world.middle, 1.0])[:3]
        expected = world.middle + (0.2 * world.axis if joint.type == "prismatic" else 0.0)
        np.testing.assert_allclose(turned, expected, atol=1e-12)


# --- Faces of capsules and obstacles: they lie on the surfaces that distances are measured from -----------------------

CELL = {"obstacles": [
    {"name": "table", "kind": "box", "size": ["1.2 m", "0.8 m", "20 mm"], "xyz": ["0.5 m", "0 m", "-30 mm"],
     "rpy": ["0 deg", "5 deg", "30 deg"]},
    {"name": "post", "kind": "cylinder", "radius": "60 mm", "length": "0.5 m", "xyz": ["0.3 m", "0.4 m", "0.4 m"],
     "rpy": ["40 deg", "0 deg", "0 deg"]},
    {"name": "lamp", "kind": "sphere", "radius": "80 mm", "xyz": ["0.5 m", "0.2 m", "0.6 m"]},
    {"name": "ground", "kind": "half_space", "normal": [0.1, 0, 1], "offset": "-50 mm"},
]}  # fmt: skip


def problem(cell):
    return po.problem_from_dict({"robot": {"kind": "preset", "name": "panda"}, "cell": cell})


def test_faces_of_a_capsule_are_on_it() -> None:
    a, b = np.array([0.1, 0.2, 0.3]), np.array([0.4, -0.2, 0.5])
    corners = capsule_facets(a, b, 0.07).reshape(-1, 3)
    assert from_segment(corners, a, b) == pytest.approx(0.07)
    assert np.ptp(corners @ (b - a)) == pytest.approx((b - a) @ (b - a) + 2 * 0.07 * np.linalg.norm(b - a))


@pytest.mark.parametrize("k", range(4))
def test_faces_of_an_obstacle_touch_it(k: int) -> None:
    obstacle = problem(CELL).scene.obstacles[k]
    low, high = np.array([-0.5, -0.5, -0.2]), np.array([1.0, 0.5, 1.0])
    corners = obstacle.facets(low, high).reshape(-1, 3)
    assert len(corners) > 100
    assert np.abs(obstacle.distance(corners, corners)).max() < 1e-9
