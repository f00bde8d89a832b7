"""The spread at one posture: its axes, frames, budget, document and messages."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posture_opt as po
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.sources.sources import Sources
from posture_opt.uncertainty.spread.budget import SHARE_TOLERANCE, budget, budgets
from posture_opt.uncertainty.spread.spread_parts import spread_parts
from tests.helpers.factors import pose
from tests.helpers.moments import correlated, errors_of, planar
from tests.helpers.planar_2r import position
from tests.helpers.shipped import preset_robot
from tests.helpers.stated import stated

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


# ProblemDocument and messages


@pytest.mark.parametrize(("posture", "words"), [
    ((0.1,), "1 value given for 2 joints – give 2 values: joint1, joint2"),
    ((0.1, 0.2, 0.3), "3 values given for 2 joints"),
    ({"joint1": 0.1}, "no value for joint2"),
    ({"joint1": 0.1, "jiont2": 0.2}, "did you mean 'joint2'?"),
    ((0.1, math.nan), "posture.joint2: the value is nan"),
    ((0.1, math.inf), "posture.joint2: the value is inf"),
    ((0.1, "90 mm"), "posture.joint2: 'mm' is not a unit of angle"),
    ((0.1, True), "posture.joint2: True is no number"),
    (0.1, "0.1 is no posture"),
    ("90 deg, 5", "posture.joint2: the angle has no unit"),
    (b"90 deg, 0 deg", "is no posture"),
])  # fmt: skip
def test_a_posture_that_is_none_is_refused_by_name(posture, words):
    with pytest.raises(po.errors.InputError) as caught:
        po.propagate(planar(), posture)
    assert words in str(caught.value)


def test_nothing_uncertain_is_refused_with_the_hint():
    with pytest.raises(po.errors.InputError, match=r"uncertainty: \{repeatability: 0.05 mm\}"):
        po.propagate(stated(robot=preset_robot("planar_2r"), sources=Sources()), BENT)


# --- Scatter and what is not known of errors that stay, of a planar arm whose derivatives are taken by differences ----

Q = (0.4, 1.1)
KNOWN, EACH = 1e-3, 3e-4  # rad: of the second joint, stays; of the first, anew at every repeat


def problem(**uncertainty: object) -> po.Problem:
    joint = {"type": "revolute", "a": "1 m"}
    return po.problem_from_dict(
        {
            "robot": {"kind": "dh", "joints": [{"name": name, **joint} for name in ("joint1", "joint2")]},
            "uncertainty": uncertainty,
        }
    )


def radius(sigma: np.ndarray) -> float:
    """95 % of draws of independent coordinates stay within."""
    drawn = np.random.default_rng(0).normal(size=(400_000, len(sigma))) * sigma
    return float(np.quantile(np.linalg.norm(drawn, axis=1), 0.95))


def moved(joint: int) -> np.ndarray:
    """(2,) shift of the tool point per radian of a joint."""
    step = np.zeros(2)
    step[joint] = 1e-6
    q = np.array(Q)
    links = (1.0, 1.0)
    return (position((q + step)[None], links) - position((q - step)[None], links))[0] / 2e-6


def test_each_part_has_its_own_size() -> None:
    stated = problem(sigma={"joint2.theta": "1 mrad"}, scatter={"joint1.theta": "0.3 mrad"})
    parts = spread_parts(po.propagate(stated, Q), np.eye(3)[:, :2])
    scatter, systematic = EACH * np.linalg.norm(moved(0)), KNOWN * np.linalg.norm(moved(1))
    assert parts.scatter_sigma == pytest.approx(scatter, rel=1e-4)
    assert parts.systematic_sigma == pytest.approx(systematic, rel=1e-4)
    assert parts.scatter_radius == pytest.approx(radius(np.array([scatter])), rel=0.01)
    assert parts.systematic_radius == pytest.approx(radius(np.array([systematic])), rel=0.01)
    assert parts.parameters == ("joint2.theta",)
    assert parts.mostly_systematic
    document = parts.to_json()
    assert document["systematic"]["parameters"] == ["joint2.theta"]
    assert document["scatter"]["sigma_max"] == parts.scatter_sigma


# --- Budgets of correlated sources: no line below zero, the lines sum to one, groups are those that vary together -----

Q6_GROUPS = (0.3, -1.0, 1.2, 0.4, 0.7, 0.0)
OPPOSED = {
    "robot": {"kind": "preset", "name": "planar_2r"},
    "uncertainty": {
        "sigma": {"joint1.theta": "0.1 deg", "joint1.a": "10 mm", "joint2.a": "8 mm"},
        "correlation": [["joint1.a", "joint2.a", -0.9]],
    },
    "task": {"kind": "insert", "direction": [0, -1, 0]},
}


def test_two_lengths_that_cancel_are_one_line() -> None:
    # Both links along x: the shift is e1 + e2, its variance 100 + 64 - 2 * 0.9 * 80 = 20 mm^2; the share of joint2.a
    # alone would be (64 - 72) / 20 = -40 %.
    spread = po.propagate(po.problem_from_dict(OPPOSED), [0.0, 0.0])
    assert spread.for_task is not None
    assert {s.parameter: round(s.share, 2) for s in spread.for_task.budget}["joint2.a"] == -0.4
    lengths, angle = spread.for_task.budget_groups
    assert set(lengths.parameters) == {"joint1.a", "joint2.a"}
    assert lengths.share + angle.share == pytest.approx(1.0)
    assert lengths.share == pytest.approx(1.0, abs=1e-3)
    report = spread.report()
    assert "-40 %" not in report
    document = spread.to_json()
    assert {entry["parameter"] for entry in document["critical_budget"]} == {"joint1.theta", "joint1.a", "joint2.a"}
    assert set(document["critical_budget_groups"][0]["parameters"]) == {"joint1.a", "joint2.a"}


@pytest.mark.parametrize("seed", range(6))
def test_dense_covariances_have_no_line_below_zero(seed: int) -> None:
    robot = po.load_problem("insert_ur10").robot
    rng = np.random.default_rng(seed)
    names = tuple(f"{joint}.{p}" for joint in robot.joint_names for p in ("theta", "a", "d"))
    A = rng.standard_normal((len(names), 4)) * 2e-4
    sources = Sources(names, A @ A.T + 1e-10 * np.eye(len(names)))
    spread = po.propagate(stated(robot, sources), Q6_GROUPS)
    groups = spread.budget_groups
    assert sum(g.share for g in groups) == pytest.approx(1.0)
    assert min(g.share for g in groups) > -SHARE_TOLERANCE
    assert sorted(p for g in groups for p in g.parameters) == sorted(s.parameter for s in spread.budget)
    assert [g.share for g in groups] == sorted((g.share for g in groups), reverse=True)
    assert min(s.share for s in spread.budget) < -SHARE_TOLERANCE  # or this test would say nothing
    (own,) = budgets(spread.tool_point, spread.q, spread.axes[-1:])
    assert {s.parameter: s.share for s in own} == {s.parameter: s.share for s in spread.budget}
