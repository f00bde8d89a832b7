"""Joint sigmas from a data sheet: the repeatability that they give back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import posture_opt as po
from posture_opt.robot.robot import Factor
from posture_opt.uncertainty.repeatability import joint_sigmas, matching_postures, repeatability_from_covariance
from tests.helpers.factors import parameter_jacobian
from tests.helpers.shipped import preset_robot
from tests.helpers.stated import stated
from tests.helpers.variants import STRUCTURES, conformance


def predicted(robot, sources, q):
    return repeatability_from_covariance(po.propagate(stated(robot=robot, sources=sources), q).covariance)


@pytest.mark.parametrize("name", conformance(STRUCTURES, ["planar_2r", "scara", "ur10", "kr6_r900", "panda"]))
def test_the_median_repeatability_is_the_data_sheet_s(name):
    robot = preset_robot(name)
    sources = joint_sigmas(robot, 1e-4)
    found = [predicted(robot, sources, q) for q in matching_postures(robot)]
    # the exact covariance instead of the first order: relative difference sigma^2 < 1e-8
    assert np.median(found) == pytest.approx(1e-4, rel=1e-6)


def test_one_hinge_by_hand():
    hinge = replace(preset_robot("planar_2r"), joints=preset_robot("planar_2r").joints[:1],
                    links=preset_robot("planar_2r").links[:1])  # fmt: skip
    # l = r |N(0, s)|: E l = r s sqrt(2 / pi), sd = r s sqrt(1 - 2 / pi), so RP = 2.60632 r s; r = 1 m everywhere
    (sigma,) = joint_sigmas(hinge, 1e-4).sigma
    assert sigma == pytest.approx(1e-4 / 2.60632, rel=2e-6)


def test_slides_of_a_portal_by_hand():
    # three slides along x, y, z: isotropic scatter, RP = 3.61609 s in every posture
    joint = preset_robot("scara").joints[2]
    joints = tuple(replace(joint, name=f"slide{k}") for k in range(3))
    links = tuple((Factor("translate", k, 0.0, f"slide{k}.d", k),) for k in range(3))  # type: ignore[arg-type]
    sources = joint_sigmas(po.Robot("portal", joints, links), 1e-4)
    np.testing.assert_allclose(sources.sigma, 1e-4 / 3.61609, rtol=2e-6)
    assert "mm each" in sources.notes[0]


def test_a_simulated_test_gives_the_data_sheet_s_figure():
    robot = preset_robot("ur10e")
    sources = joint_sigmas(robot, 5e-5)
    found = []
    for seed, q in enumerate(matching_postures(robot)):
        points = po.simulate(stated(robot=robot, sources=sources), q, n=2000, seed=seed).points
        distance = np.linalg.norm(points - points.mean(axis=0), axis=1)
        found.append(distance.mean() + 3 * distance.std(ddof=1))
    # RP of 2000 cycles scatters by 1.1 %; near the median of 200 that leaves well under 1 %
    assert np.median(found) == pytest.approx(5e-5, rel=0.01)


def test_weights_share_it_out():
    robot = preset_robot("ur5")
    first, second, *rest = robot.joint_names
    sources = joint_sigmas(robot, 1e-4, {first: 0.0, second: 2.0})
    assert sources.names == tuple(f"{name}.theta" for name in (second, *rest))
    np.testing.assert_allclose(sources.sigma / sources.sigma[-1], [2, 1, 1, 1, 1], rtol=1e-12)
    assert "with the given weights" in sources.notes[0]
    found = [predicted(robot, sources, q) for q in matching_postures(robot)]
    assert np.median(found) == pytest.approx(1e-4, rel=1e-6)


def test_a_slide_scatters_the_tool_point_as_a_turn_does():
    robot = preset_robot("scara")
    sources = joint_sigmas(robot, 1e-5)
    sigma = dict(zip(sources.names, sources.sigma, strict=True))
    slide = next(f"{j.name}.d" for j in robot.joints if j.type == "prismatic")
    turns = [s for name, s in sigma.items() if name != slide]
    shifts = []
    for q in matching_postures(robot):
        columns = parameter_jacobian(robot, q, [name for name in sigma if name != slide])
        shifts += np.sum(columns**2, axis=0).tolist()
    assert sigma[slide] == pytest.approx(turns[0] * math.sqrt(np.mean(shifts)), rel=1e-6)


@pytest.mark.parametrize("name", conformance(STRUCTURES, ["planar_2r", "scara", "ur10", "kr6_r900", "panda"]))
def test_the_postures_lie_within_the_limits_in_the_middle_of_the_reach(name):
    robot = preset_robot(name)
    Q = matching_postures(robot)
    assert Q.shape == (200, robot.n)
    for joint, values in zip(robot.joints, Q.T, strict=True):
        assert (values >= joint.lower - 1e-12).all()
        assert (values <= joint.upper + 1e-12).all()
        span = min(joint.upper - joint.lower, 2 * math.pi)
        assert np.ptp(values) > 0.6 * span  # spread, not clustered
    np.testing.assert_array_equal(Q, matching_postures(robot))


@pytest.mark.parametrize(("repeatability", "weights", "words"), [
    (0.0, {}, "the repeatability is 0 m"),
    (math.nan, {}, "the repeatability is nan m"),
    (1e-4, {"elbo": 1.0}, "no such joint"),
    (1e-4, {"elbow": -1.0}, "the weight is -1"),
    (1e-4, {"elbow": math.inf}, "the weight is inf"),
])  # fmt: skip
def test_bad_figures_are_refused(repeatability, weights, words):
    with pytest.raises(po.errors.InputError, match=words):
        joint_sigmas(preset_robot("ur5"), repeatability, weights)


def test_joints_that_do_not_move_the_tool_point_cannot_scatter_it():
    robot = preset_robot("ur5")
    last = robot.joint_names[-1]  # its axis passes through the tool point
    with pytest.raises(po.errors.InputError, match="do not move the tool point"):
        joint_sigmas(robot, 1e-4, {name: float(name == last) for name in robot.joint_names})
