"""The spread at one posture: its axes, frames, budget, document and messages."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posture_opt as po
from posture_opt.uncertainty.budget import budget
from posture_opt.uncertainty.tool_point import ToolPoint
from tests.helpers.factors import pose
from tests.helpers.moments import correlated, errors_of, planar
from tests.helpers.shipped import preset_robot
from tests.helpers.stated import Sources, moved_base, stated

BENT = np.radians((90, -135))
Q6 = (0.3, -1.1, 1.2, -0.5, 0.7, 0.2)


def spatial(angle=1e-3, length=1e-4, kinds=("theta", "a", "d")):
    robot = preset_robot("ur5")
    return stated(robot=robot, sources=errors_of(robot, angle, length, kinds))


def shares(found):
    return {share.parameter: share.share for share in found}


def test_a_planar_arm_has_an_ellipse_with_the_factor_of_the_plane():
    spread = po.propagate(planar(1, 3), BENT)
    # 95 % of a plane Gaussian: sqrt(-2 ln 0.05) = 2.4477; semi-axes of the lecture's table
    np.testing.assert_allclose(spread.ellipse.semi_axes, [0.01736302, 0.05305184], atol=5.1e-9)
    np.testing.assert_allclose(spread.region(0.95), 2.447746831 * spread.ellipse.semi_axes, rtol=1e-9)
    np.testing.assert_allclose(spread.ellipse.center, [0.706031, 0.293817], atol=5.1e-7)
    assert spread.to_json()["ellipse"]["coverage95_factor"] == pytest.approx(2.4477, abs=5e-5)


def test_a_planar_arm_whose_tool_point_may_leave_the_plane_has_an_ellipsoid():
    robot = preset_robot("planar_2r")
    for sigma in ({"joint1.theta": 0.01, "joint2.d": 1e-3}, {"joint1.theta": 0.01, "joint1.alpha": 0.01}):
        spread = po.propagate(stated(robot=robot, sources=Sources.independent(sigma)), BENT)
        assert spread.ellipse.semi_axes.shape == (3,)


def test_a_tool_point_that_scatters_along_a_line_has_the_factor_of_a_line():
    lengths = Sources.independent({"joint1.a": 0.01, "joint2.a": 0.01})
    spread = po.propagate(stated(robot=preset_robot("planar_2r"), sources=lengths), np.radians((90, -180)))
    np.testing.assert_allclose(spread.covariance, np.diag([0, 2e-4, 0]), atol=1e-18)
    assert spread.to_json()["ellipse"]["coverage95_factor"] == pytest.approx(1.96, abs=5e-5)


@pytest.mark.parametrize("angles", [(math.pi, 0, 0), (0, math.pi, 0), (0, 0, math.pi)])
def test_the_quaternion_keeps_its_digits_at_half_turns(angles):
    robot = moved_base(preset_robot("planar_2r"), (0, 0, 0), angles)
    w, x, y, z = po.propagate(planar(robot=robot), (0.0, 0.0)).quaternion_wxyz
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), pose(robot, (0, 0))[:3, :3], atol=1e-15)


def test_pose_covariance_is_that_of_shift_and_rotation_in_world_axes():
    problem = spatial(1e-7, 1e-7)
    spread = po.propagate(problem, Q6)
    names, S = problem.sources.names, problem.sources.covariance
    columns = np.array([pose_difference(problem.robot, Q6, name) for name in names]).T
    expected = columns @ S @ columns.T
    # central differences of step 1e-5: relative error 1e-10; beyond first order stands 1e-14
    np.testing.assert_allclose(spread.pose_covariance, expected, rtol=0, atol=1e-9 * expected.max())


def pose_difference(robot, q, name, h=1e-5):
    plus, minus = pose(robot, q, {name: h}), pose(robot, q, {name: -h})
    turn = Rotation.from_matrix(plus[:3, :3] @ minus[:3, :3].T).as_rotvec()
    return np.concatenate([plus[:3, 3] - minus[:3, 3], turn]) / (2 * h)


# Error budget


def test_budget_to_first_order_is_that_of_the_gum():
    problem = spatial(1e-6, 1e-6)
    spread = po.propagate(problem, Q6)
    tool_point = spread.tool_point
    J = np.asarray(tool_point.jacobian(tool_point.walk(Q6)[0]))
    for u, found in zip(spread.axes, spread.axis_budgets, strict=True):
        parts = (u @ J) ** 2 * np.diag(tool_point.covariance)
        expected = dict(zip(tool_point.names, parts / parts.sum(), strict=True))
        # curvature at sigma = 1e-6 is 1e-12 of the variance; differences in log sigma are good to 1e-8
        assert shares(found) == pytest.approx(expected, abs=2e-8)


@pytest.mark.parametrize("arm", ["planar", "spatial"])
def test_budget_is_the_elasticity_of_the_reported_covariance(arm):
    if arm == "planar":
        problem, q = planar(5, 5), (0.4, -1.0)
    else:
        problem, q = spatial(0.02, 0.004), Q6  # nodes are good to 1e-5 here
    problem.sources = correlated(problem.sources)
    u = np.array([0.6, 0.8, 0.0])
    tool_point = ToolPoint.of(problem.arm, problem.sources)

    def variance(factors):
        S = tool_point.covariance * np.outer(factors, factors)
        return u @ np.asarray(replace(tool_point, covariance=S).moments(list(q)).covariance) @ u

    k = len(tool_point.names)
    # all sigmas together: the elasticities sum to half the derivative along that direction
    steps = np.eye(k) * 1e-3
    gradient = np.array([(variance(np.exp(s)) - variance(np.exp(-s))) / 4e-3 for s in steps])
    expected = dict(zip(tool_point.names, gradient / gradient.sum(), strict=True))
    assert shares(budget(tool_point, q, u)) == pytest.approx(expected, abs=1e-5)  # differences of step 1e-3


def test_the_budget_of_a_spread_is_that_of_its_longest_axis():
    spread = po.propagate(planar(1, 3), BENT)
    assert spread.budget == spread.axis_budgets[-1]
    assert spread.budget[0].parameter == "joint2.theta"
    document = spread.to_json()
    assert document["budget"][0]["parameter"] == "joint2.theta"
    assert len(document["budget_of_axes"]) == 2


# ProblemDocument and messages

KEYS = {
    *("posture", "tool", "covariance", "covariance_first_order", "bias"),
    *("pose_covariance", "ellipse", "budget", "validity"),
}


@pytest.mark.parametrize("problem", [planar(1, 1, 0.0), spatial(), planar(0, 0, 0.0)])
def test_the_document_has_its_keys_and_finite_numbers(problem):
    q = np.radians((90, -180)) if problem.robot.n == 2 else Q6
    document = po.propagate(problem, q).to_json()
    assert set(document) >= KEYS
    assert set(document["ellipse"]) >= {"semi_axes_1sigma", "axes", "coverage95_factor"}
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["posture"] == dict(zip(problem.robot.joint_names, map(float, q), strict=True))
    assert np.shape(document["pose_covariance"]) == (6, 6)


def test_method_says_how():
    assert po.propagate(spatial(), Q6).method == "exact"
    flat = planar()
    assert po.propagate(stated(robot=flat.robot, sources=correlated(flat.sources)), BENT).method == "exact, planar"
    both = stated(robot=spatial().robot, sources=correlated(spatial().sources))
    spread = po.propagate(both, Q6)
    assert spread.method == "exact given shared factors, integrated over them"
    stated_error = spread.to_json()["integration"]
    assert stated_error["factors"] == spread.tool_point.shared.count > 0
    assert 0 <= stated_error["relative_error"] < 1e-6
    assert "integration" not in po.propagate(spatial(), Q6).to_json()


def test_bias_is_exact_mean_less_nominal():
    spread = po.propagate(planar(1, 3), np.radians((90, -180)))
    np.testing.assert_allclose(spread.bias, [0, 0.001370, 0], atol=5.1e-7)  # printed: seven decimals


@pytest.mark.parametrize(("posture", "words"), [
    ((0.1,), "1 value given for 2 joints – give 2 values: joint1, joint2"),
    ({"joint1": 0.1}, "no value for joint2"),
    ({"joint1": 0.1, "jiont2": 0.2}, "did you mean 'joint2'?"),
    ((0.1, math.nan), "posture.joint2: the value is nan"),
    ((0.1, "90 mm"), "posture.joint2: 'mm' is not a unit of angle"),
    ((0.1, True), "posture.joint2: True is no number"),
    (0.1, "0.1 is no posture"),
    ("90 deg, 5", "posture.joint2: the angle has no unit"),
])  # fmt: skip
def test_a_posture_that_is_none_is_refused_by_name(posture, words):
    with pytest.raises(po.errors.InputError) as caught:
        po.propagate(planar(), posture)
    assert words in str(caught.value)


def test_all_faults_of_a_posture_are_named_at_once():
    with pytest.raises(po.errors.InputError) as caught:
        po.propagate(planar(), (math.nan, math.inf))
    assert len(caught.value.issues) == 2


def test_nothing_uncertain_is_refused_with_the_hint():
    with pytest.raises(po.errors.InputError, match=r"uncertainty: \{repeatability: 0.05 mm\}"):
        po.propagate(stated(robot=preset_robot("planar_2r"), sources=Sources()), BENT)


def test_limits_are_noted_not_enforced():
    spread = po.propagate(planar(), np.radians((190, -180)))
    assert spread.notes == ("joint1 is 10 deg above its upper limit of 180 deg.",)
    scara = stated(robot=preset_robot("scara"), sources=Sources.independent({"joint1.theta": 1e-4}))
    lower = scara.robot.joints[2].lower
    (note,) = po.propagate(scara, (0, 0, lower - 0.002, 0)).notes
    assert note.startswith(f"{scara.robot.joint_names[2]} is 2 mm below its lower limit")
