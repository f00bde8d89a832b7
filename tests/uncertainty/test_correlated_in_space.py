"""Correlated errors of spatial arms: split into shared factors, exact given these, and mixed over nodes for them."""

from __future__ import annotations

from itertools import product

import casadi as ca
import numpy as np
import pytest

import posture_opt as po
from posture_opt.uncertainty.integration import SharedFactors
from posture_opt.uncertainty.tool_point import ToolPoint
from tests.helpers.moments import correlated, errors_of, scaled, with_correlations
from tests.helpers.sampled import sampled_pose
from tests.helpers.shipped import preset_robot
from tests.helpers.stated import Sources, moved_base, stated
from tests.helpers.variants import conformance

Q6 = (0.3, -1.1, 1.2, -0.5, 0.7, 0.2)
STRETCHED = (0.3, -1.0, 0.0, -0.6, 0.0, 0.2)


def joints(robot="ur10", R=None):
    """One radian at every joint, with the correlations R or none."""
    sources = errors_of(preset_robot(robot), 1.0, 0.1, ("theta",))
    return sources if R is None else with_correlations(sources, R)


def pairs(k, *entries):
    R = np.eye(k)
    for i, j, rho in entries:
        R[i, j] = R[j, i] = rho
    return R


def equal(k, rho):
    return np.full((k, k), rho) + (1 - rho) * np.eye(k)


def lengths_and_angles():
    """Joint angles, link lengths and offsets of a UR10 all correlated: 1 rad, 0.5 m."""
    return correlated(errors_of(preset_robot("ur10"), 1.0, 0.5, ("theta", "a")), seed=3)


def stanford():
    """An arm with a prismatic third joint: Scheinman's, with a wrist that is offset by 50 mm."""
    d, a, alpha = (0.4, 0.15, 0, 0, 0, 0.25), (0, 0, 0, 0, 0, 0.05), (-90, 90, 0, -90, 90, 0)
    rows = [
        {"name": f"j{k + 1}", "type": "prismatic" if k == 2 else "revolute", "d": f"{d[k]} m", "a": f"{a[k]} m"}
        | {"alpha": f"{alpha[k]} deg", "theta": "-90 deg" if k == 2 else "0 deg"}
        | {"limits": ["0 m", "0.8 m"] if k == 2 else ["-170 deg", "170 deg"]}
        for k in range(6)
    ]
    content = {"name": "Stanford arm", "robot": {"kind": "dh", "joints": rows}, "task": {"kind": "insert"}}
    return po.problem_from_dict(content).robot


def arm_of(name):
    return stanford() if name == "stanford" else preset_robot(name)


def stage_and_angles():
    """The stage (0.3 m a radian) of the Stanford arm and five angles, dense correlations."""
    robot = stanford()
    sigma = {robot.factors[i].parameter: 0.3 if robot.factors[i].kind == "translate" else 1.0 for i in robot.driven}
    return correlated(Sources.independent(sigma), seed=5)


def stages_alone():
    """Lengths that vary together, and angles that do not: two nodes a factor, whatever the size."""
    sources = errors_of(preset_robot("ur10"), 1.0, 0.5, ("theta", "a"))
    lengths = [k for k, name in enumerate(sources.names) if name.endswith(".a")]
    return with_correlations(sources, pairs(12, (lengths[1], lengths[2], 0.9), (lengths[0], lengths[5], -0.4)))


CASES = {
    "one pair": ("ur10", lambda: joints(R=pairs(6, (1, 2, 0.8)))),
    "one pair, against each other": ("ur10", lambda: joints(R=pairs(6, (0, 4, -0.8)))),
    "three pairs that overlap": ("ur10", lambda: joints(R=pairs(6, (0, 3, 0.8), (1, 4, 0.6), (2, 5, -0.7)))),
    "three pairs in a row": ("ur10", lambda: joints(R=pairs(6, (0, 1, 0.8), (2, 3, 0.6), (4, 5, -0.7)))),
    "equal": ("ur10", lambda: joints(R=equal(6, 0.8))), "one shaft": ("ur10", lambda: joints(R=equal(6, 1.0))),
    "dense": ("ur10", lambda: correlated(joints(), seed=7)),
    "rank two": ("ur10", lambda: correlated(joints(), seed=7, dof=2)),
    "lengths and angles": ("ur10", lengths_and_angles), "a prismatic joint": ("stanford", stage_and_angles),
    "lengths alone": ("ur10", stages_alone), "seven joints, equal": ("panda", lambda: joints("panda", equal(7, 0.5))),
}  # fmt: skip
"""Arm and sources with σ = 1 rad."""


def spread_of(case, sigma, q):
    robot, sources = CASES[case]
    robot = arm_of(robot)
    return po.propagate(stated(robot=robot, sources=scaled(sources(), np.radians(sigma))), (*q, 0.4)[: robot.n])


@pytest.mark.parametrize(
    ("case", "sigma", "q"),
    conformance(
        [*product(CASES, [1], [Q6]), *product(CASES, [20], [STRETCHED]), ("one pair", 30, Q6), ("dense", 0.01, Q6)],
        [
            ("rank two", 20, STRETCHED), ("one shaft", 1, Q6), ("lengths and angles", 20, STRETCHED),
            ("a prismatic joint", 20, STRETCHED), ("lengths alone", 1, Q6),
        ],
    ),
)  # fmt: skip
def test_moments_are_those_of_samples(case, sigma, q):
    spread = spread_of(case, sigma, q)
    sources = spread.problem.sources
    mean, C, of_mean, of_C = sampled_pose(spread.robot, spread.q, sources.names, sources.covariance, 200_000)
    # Five standard errors: missed once in a million entries by a right formula, a thousand are compared; of 40 blocks
    # the standard error itself is known to a tenth. Beside it, the error that the integration states of itself.
    size = np.sqrt(np.outer(np.diag(C), np.diag(C)))
    stated_error = spread.integration.relative_error * size[:3, :3]
    assert (np.abs(spread.covariance - C[:3, :3]) <= 5.5 * of_C[:3, :3] + stated_error).all()
    assert (np.abs(spread.bias - mean[:3]) <= 5.5 * of_mean[:3] + 1e-15).all()
    assert spread.method == "exact given shared factors, integrated over them"
    assert spread.integration.relative_error < (1e-2 if case == "lengths and angles" else 1e-5)


@pytest.mark.parametrize("case", ["equal", "one shaft", "dense", "lengths and angles", "a prismatic joint"])
@pytest.mark.parametrize("sigma", [1e-9])
def test_small_errors_keep_their_digits(case, sigma):
    robot, sources = CASES[case]
    problem = stated(robot=arm_of(robot), sources=scaled(sources(), sigma))
    spread = po.propagate(problem, Q6)
    # C = J S J' (1 + O(s^2)): six errors of one sign turn by 6 s. Raw moments would lose all digits at 1e-9.
    size = np.sqrt(np.outer(np.diag(spread.first_order), np.diag(spread.first_order)))
    assert (np.abs(spread.covariance - spread.first_order) <= (1000 * sigma**2 + 1e-13) * size).all()
    pose = spread.pose_covariance
    first = first_order_pose(spread)
    size = np.sqrt(np.outer(np.diag(first), np.diag(first)))
    assert (np.abs(pose - first) <= (1000 * sigma**2 + 1e-13) * size).all()


def first_order_pose(spread):
    T = np.asarray(spread.tool_point.twists(spread.q, spread.tool_point.walk(spread.q)[0]), dtype=float)
    return T @ spread.tool_point.covariance @ T.T


def random_correlations(rng, k):
    """Of any rank, some sources the same as others or their opposite, some independent."""
    R = correlated(joints(), seed=int(rng.integers(1 << 30)), dof=int(rng.integers(1, 13))).covariance
    R = R / np.sqrt(np.outer(np.diag(R), np.diag(R)))
    if rng.random() < 0.3:  # twins
        i, j = rng.choice(k, 2, replace=False)
        sign = rng.choice([-1.0, 1.0])
        R[i], R[:, i] = sign * R[j], sign * R[:, j]
        R[i, i] = 1.0
    alone = rng.random(k) < 0.2
    R[alone], R[:, alone] = 0.0, 0.0
    np.fill_diagonal(R, 1.0)
    return R


@pytest.mark.parametrize("seed", conformance(range(8), range(2)))
def test_every_covariance_is_positive_semidefinite(seed):
    rng = np.random.default_rng(seed)
    robot = preset_robot("ur10")
    sigma = np.radians(10.0 ** rng.uniform(-2, 1.8, 6))
    sources = with_correlations(joints(), random_correlations(rng, 6))
    sources = Sources(sources.names, sources.covariance * np.outer(sigma, sigma))
    tool_point = ToolPoint.of(po.Arm(robot), sources)
    q = rng.uniform(-3, 3, 6)
    q[rng.random(6) < 0.3] = 0.0  # singular postures among them
    symbol = ca.SX.sym("q", 6)
    symbolic = ca.Function("C", [symbol], [tool_point.moments(ca.vertsplit(symbol)).covariance])
    spread = po.propagate(stated(robot=robot, sources=sources), q)
    batch = tool_point.moments([np.array([value]) for value in q]).covariance
    for C in (spread.covariance, symbolic(q).full(), batch.reshape(3, 3), spread.pose_covariance):
        units = np.sqrt(np.diag(C))
        values = np.linalg.eigvalsh(C / np.outer(units, units))
        assert values[0] > -1e-13  # rounding of sums of order one
    np.testing.assert_array_equal(spread.pose_covariance[:3, :3], spread.covariance)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_full_correlation_is_one_error(sign):
    """ρ = ±1 of base.z turned by the first joint's angle: one rotation by twice the angle, or none."""
    robot = preset_robot("ur10")
    names = ("base.yaw", "shoulder_pan.theta")
    R = np.array([[1.0, sign], [sign, 1.0]])
    upright = moved_base(robot, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    both = po.propagate(stated(robot=upright, sources=Sources(names, 0.3**2 * R)), Q6)
    twice = Sources(names[1:], np.array([[(0.3 * (1 + sign)) ** 2]]))
    if sign > 0:
        alone = po.propagate(stated(robot=upright, sources=twice), Q6)
        np.testing.assert_allclose(both.covariance, alone.covariance, atol=1e-9)
        np.testing.assert_allclose(both.bias, alone.bias, atol=1e-9)
    else:
        np.testing.assert_allclose(both.covariance, 0, atol=1e-15)


@pytest.mark.parametrize("big", [1e-3, 1.0])
def test_errors_that_cancel_leave_what_is_small(big):
    """After a calibration the base and the first joint may each be known badly, and their sum well."""
    robot = moved_base(preset_robot("ur10"), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    names = ("base.yaw", *(f"{joint}.theta" for joint in robot.joint_names))
    small = correlated(Sources(names, 1e-6**2 * np.eye(7)), seed=4).covariance
    loose = np.zeros(7)
    loose[:2] = big, -big
    tight = po.propagate(stated(robot=robot, sources=Sources(names, small)), Q6)
    found = po.propagate(stated(robot=robot, sources=Sources(names, small + np.outer(loose, loose))), Q6)
    # The matrix itself holds the small ones beside big^2 to 1e-16 of it.
    rounding = 1e-14 * (big / 1e-6) ** 2
    np.testing.assert_allclose(
        found.covariance, tight.covariance, rtol=0, atol=(1e-6 + rounding) * tight.covariance.max()
    )


def correlations(rng, k, rank, own=0.0):
    A = rng.standard_normal((k, rank))
    S = A @ A.T + own * np.eye(k)
    return S / np.sqrt(np.outer(np.diag(S), np.diag(S)))


def split(covariance, turning=None):
    turning = np.ones(len(covariance), dtype=bool) if turning is None else np.array(turning)
    found = SharedFactors.of(covariance, turning)
    units = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    again = np.diag(found.own) + found.loadings @ found.loadings.T
    np.testing.assert_allclose(again / units, covariance / units, atol=1e-9)  # what the barrier leaves of a zero
    assert (found.own >= 0).all()
    return found


@pytest.mark.parametrize("rho", [0.01, 0.999, 1.0])
@pytest.mark.parametrize("k", [3, 12])
def test_equal_correlations_share_one_factor(k, rho):
    found = split(np.full((k, k), rho) + (1 - rho) * np.eye(k))
    assert found.count == 1
    np.testing.assert_allclose(found.own, 1 - rho, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_any_covariance_of_any_rank_is_split(seed):
    rng = np.random.default_rng(seed)
    k = int(rng.integers(2, 16))
    R = correlations(rng, k, int(rng.integers(1, 2 * k)))
    sigma = 10.0 ** rng.uniform(-9, 0, k)
    found = split(R * np.outer(sigma, sigma))
    assert found.count <= max(1, k - 1)
    # No diagonal of a larger sum was missed: that of the smallest eigenvalue is one that is allowed.
    assert (found.own / sigma**2).sum() >= k * np.linalg.eigvalsh(R)[0] - 1e-9


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("faint", [1e-4, 1e-8, 1e-11])
def test_a_combination_without_variance_that_hardly_names_some_sources(seed, faint):
    # As after a calibration: what the data fix, up to a faint part in sources that are free otherwise. Their diagonal
    # would leave a negative variance, and errors that cancel would not.
    rng = np.random.default_rng(seed)
    v = rng.standard_normal(8)
    v[2:] *= faint
    P = np.eye(8) - np.outer(v, v) / (v @ v)
    R = P @ (correlations(rng, 8, 8) + 0.3 * np.eye(8)) @ P
    split(R / np.sqrt(np.outer(np.diag(R), np.diag(R))))  # which compares the sum of its parts


def test_factors_that_only_shift_are_told_apart():
    R = correlations(np.random.default_rng(1), 8, 16)
    found = split(R, [True, True, True, False, False, False, False, False])
    moving = np.linalg.norm(found.loadings[:3], axis=0)
    assert found.count > 3
    assert np.count_nonzero(moving) == 3  # three angles are turned by three factors, whatever their number
    assert (np.diff(moving) <= 1e-15).all()
