"""Faces of capsules and obstacles: they lie on the surfaces that distances are measured from."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.collision.facets import capsule_facets
from posture_opt.report.scene.arm_geometry import obstacles_near
from tests.helpers.capsules import from_segment

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


@pytest.mark.parametrize("k", [0, 3])
def test_flat_faces_are_on_the_surface_and_not_within(k: int) -> None:
    """A step of 1 mm across a face leads 1 mm away from the obstacle on one side, and into it on the other."""
    obstacle = problem(CELL).scene.obstacles[k]
    faces = obstacle.facets(np.array([-0.5, -0.5, -0.2]), np.array([1.0, 0.5, 1.0]))
    normals = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    step = 1e-3 * normals / np.linalg.norm(normals, axis=1, keepdims=True)
    sides = [obstacle.distance(p, p) for p in (faces.mean(axis=1) + step, faces.mean(axis=1) - step)]
    np.testing.assert_allclose(np.max(sides, axis=0), 1e-3, atol=1e-9)
    assert np.min(sides, axis=0).max() <= 0


def test_only_what_is_near_is_drawn() -> None:
    far = {"name": "far", "kind": "sphere", "radius": "80 mm", "xyz": ["9 m", "0 m", "0 m"]}
    wide = {"name": "wide", "kind": "box", "size": ["20 m", "20 m", "1 m"], "xyz": ["0 m", "0 m", "-0.6 m"]}
    scene = problem({"obstacles": [far, wide]}).scene
    arm = np.array([[0.0, 0.0, 0.0], [0.6, 0.1, 0.8]])
    assert {solid.name for solid in obstacles_near(scene, arm)} == {"wide"}
