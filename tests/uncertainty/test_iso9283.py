"""ISO 9283 against closed forms, Carlson's elliptic integral and simulation; joint sigmas from a data sheet."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import elliprg

import posture_opt as po
from posture_opt.robot.robot import Factor
from posture_opt.uncertainty.regions import coverage_probability
from posture_opt.uncertainty.repeatability import (
    distance_moments,
    joint_sigmas,
    matching_postures,
    orientation_performance,
    position_accuracy,
    position_performance,
    repeatabilities,
    repeatability_from_covariance,
    repeatability_sampling,
)
from tests.helpers.factors import parameter_jacobian
from tests.helpers.shipped import preset_robot
from tests.helpers.stated import stated
from tests.helpers.variants import STRUCTURES, conformance


def test_isotropic_repeatability_and_what_it_covers():
    # Chi distributions: 1-D |z|, 2-D Rayleigh, 3-D Maxwell, each mean + 3 sd.
    line = math.sqrt(2 / math.pi) + 3 * math.sqrt(1 - 2 / math.pi)
    plane = math.sqrt(math.pi / 2) + 3 * math.sqrt(2 - math.pi / 2)
    space = math.sqrt(8 / math.pi) + 3 * math.sqrt(3 - 8 / math.pi)
    for m, (rp, printed, covered) in enumerate(
        [(line, 2.60632, 0.99085), (plane, 3.21872, 0.99437), (space, 3.61609, 0.99553)], start=1
    ):
        assert repeatability_from_covariance(np.eye(m)) == pytest.approx(rp, rel=1e-14)
        assert rp == pytest.approx(printed, abs=5.1e-6)
        assert coverage_probability(rp, m) == pytest.approx(covered, abs=5.1e-6)


def test_mean_distance_is_carlsons_elliptic_integral():
    rng = np.random.default_rng(2)
    variances = 10 ** rng.uniform(-16, 0, (500, 3))
    variances[:4] = [[1, 1, 1], [1, 0, 0], [1, 1, 0], [1e-9, 1, 1e-9]]
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    mean, sd = distance_moments(np.einsum("ij,nj->nij", np.eye(3), variances))
    expected = 2 * math.sqrt(2 / math.pi) * elliprg(*variances.T)
    np.testing.assert_allclose(mean, expected, rtol=1e-14)
    np.testing.assert_allclose(sd, np.sqrt(variances.sum(axis=1) - expected**2), rtol=1e-12)
    # Turned, the eigenvalues come back to 1e-15 of the largest.
    turned = np.einsum("ij,nj,kj->nik", Q, variances, Q)
    np.testing.assert_allclose(distance_moments(turned)[0], expected, rtol=1e-10)


@pytest.mark.parametrize(
    ("n", "bias", "relative_sd", "interval"),
    [(10, -0.069, 0.17, None), (30, -0.022, 0.093, (0.81, 1.16)), (100, -0.007, 0.05, None)],
)
def test_how_far_a_test_of_n_cycles_may_be_off(n, bias, relative_sd, interval):
    sampling = repeatability_sampling(np.eye(3), n, trials=20_000, seed=1)
    assert sampling.bias == pytest.approx(bias, abs=4 * relative_sd / math.sqrt(20_000) + 5e-4)
    assert sampling.sd / (1 + sampling.bias) == pytest.approx(relative_sd, abs=4e-3)  # printed to two digits
    if interval:
        np.testing.assert_allclose(sampling.interval, interval, atol=1e-2)


def test_position_performance_by_hand():
    # A square of side 2 about (1, 0): every distance is sqrt(2), and nothing scatters in it.
    attained = np.array([[0, -1, 0], [2, -1, 0], [2, 1, 0], [0, 1, 0]], dtype=float)
    found = position_performance(attained, [0, 0, 0])
    assert found.n == 4
    assert found.accuracy == pytest.approx(1.0)
    assert found.repeatability == pytest.approx(math.sqrt(2))
    # t(0.975, 3 dof) = 3.182446; s along x = sqrt(4/3), over sqrt(4)
    assert found.accuracy_interval[1] == pytest.approx(1 + 3.182446305 * math.sqrt(4 / 3) / 2, rel=1e-9)
    assert found.accuracy_interval[0] == 0.0
    uneven = position_performance([[0.0], [0.0], [3.0]], [1.0])  # mean 1, distances 1, 1, 2
    assert uneven.repeatability == pytest.approx(4 / 3 + 3 * math.sqrt(1 / 3))


def test_orientation_performance_across_the_half_turn():
    attained = np.array([math.pi - 0.01, -math.pi + 0.01, -math.pi + 0.03])
    found = orientation_performance(attained, math.pi)
    assert found.accuracy == pytest.approx(0.01)
    assert found.repeatability == pytest.approx(3 * 0.02)


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda: position_performance(np.zeros((2, 3)), np.zeros(3)), po.errors.InsufficientDataError),
        (lambda: position_performance(np.zeros((5, 3)), np.zeros(2)), po.errors.InputError),
        (lambda: position_performance(np.full((5, 3), math.nan), np.zeros(3)), po.errors.InputError),
        (lambda: repeatability_sampling(np.eye(3), 2), po.errors.InputError),
        (lambda: repeatability_sampling(np.zeros((3, 3))), po.errors.InputError),
        (lambda: repeatability_from_covariance(np.eye(4)), po.errors.InputError),
        (lambda: repeatabilities(np.eye(3)), po.errors.InputError),
    ],
)
def test_impossible_input_is_refused(call, error):
    with pytest.raises(error):
        call()


@pytest.mark.parametrize(("n", "d"), [(5, 3), (30, 3), (10, 2)])
@pytest.mark.parametrize("true", [0.0, 2.0])
def test_the_interval_of_the_accuracy_holds_the_true_one(n: int, d: int, true: float) -> None:
    rng = np.random.default_rng(n * d)
    sigma, hits = np.array([1.0, 2.0, 0.5])[:d], 0
    for _ in range(400):
        x = rng.normal(size=(n, d)) * sigma
        x[:, 0] += true
        low, high = position_accuracy(x, np.zeros(d))[1]
        hits += low <= true <= high
    # 95 % of 400 are 380 ± 4.4; a mean of zero was left out by one interval in nine.
    assert hits > 366


def predicted(robot, sources, q):
    return repeatability_from_covariance(po.propagate(stated(robot=robot, sources=sources), q).covariance)


@pytest.mark.parametrize("name", conformance(STRUCTURES, ["scara", "panda"]))
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


@pytest.mark.long
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
