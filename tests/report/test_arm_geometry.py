"""The geometry that pictures and the interactive view draw: in the world, true to scale, beside the moments."""

from __future__ import annotations

import numpy as np
import pytest

import posture_opt as po
from posture_opt.collision.facets import cylinder_facets, tapered_facets
from posture_opt.files import preset_names
from posture_opt.report.scene.arm_geometry import ArmGeometry, ErrorRegion
from posture_opt.report.scene.arm_solids import ArmSolids
from posture_opt.robot.preset import load_preset


def volume(faces: np.ndarray) -> float:
    """Of a closed surface of flat faces (k, 4, 3), by the divergence theorem; positive with normals outward."""
    a, b, c, d = np.moveaxis(faces, 1, 0)
    return float(np.sum(np.cross(a, b) * c + np.cross(a, c) * d) / 6)


def test_a_tapered_link_is_closed_and_as_large_as_a_cone_between_half_balls():
    found = tapered_facets(np.array([0.1, 0.2, 0.3]), np.array([0.1, 1.2, 0.3]), 0.1, 0.05)
    cone = np.pi / 3 * (0.1**2 + 0.1 * 0.05 + 0.05**2)
    balls = 2 / 3 * np.pi * (0.1**3 + 0.05**3)
    assert abs(volume(found)) == pytest.approx(cone + balls, rel=0.03)  # a polygon of 20 corners is 1.6 % smaller


def test_a_cylinder_is_closed():
    found = cylinder_facets(np.zeros(3), np.array([0.0, 0.0, 0.5]), 0.2)
    assert abs(volume(found)) == pytest.approx(np.pi * 0.2**2 * 0.5, rel=0.03)


@pytest.mark.parametrize("preset", preset_names())
def test_joints_stand_on_their_axes(preset):
    robot = load_preset(preset)
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


def test_the_geometry_of_a_spread_ends_at_its_tool_point():
    problem = po.load_problem("problems/insert_panda_cell.yaml")
    found = ArmGeometry.of_spread(po.propagate(problem, [0.1, -0.4, 0.2, -2.0, 0.3, 1.7, 0.5]))
    np.testing.assert_allclose(found.frames[-1][:3, 3], found.tool_point, atol=1e-9)
    tool = found.tool_point
    assert min(np.linalg.norm(found.points - tool, axis=1)) < 0.12  # the hand's capsules hold the tool point
    assert {obstacle.name for obstacle in found.obstacles} <= {o.name for o in problem.scene.obstacles}
    assert found.obstacles


def test_the_region_is_enlarged_about_its_mean_by_the_factor_that_it_names():
    problem = po.load_problem("problems/insert_panda_cell.yaml")
    spread = po.propagate(problem, [0.1, -0.4, 0.2, -2.0, 0.3, 1.7, 0.5])
    region = ErrorRegion.of(spread, 100.0)
    points = (region.surface().reshape(-1, 3) - region.center) / 100.0
    squared = np.einsum("ni,ij,nj->n", points, np.linalg.inv(spread.covariance), points)
    np.testing.assert_allclose(squared, 7.814727903251179, rtol=1e-9)  # the 95 % quantile of chi-squared with 3
    assert "100" in region.label
