"""Coverage factors and ellipsoids against tables, SciPy and Monte Carlo; the validity index of the first order."""

from __future__ import annotations

import json
import math

import casadi as ca
import numpy as np
import pytest
from scipy.special import chdtr, chdtri, fdtr

import posture_opt as po
from posture_opt.uncertainty.pose_covariance import Validity
from posture_opt.uncertainty.regions import (
    Ellipsoid,
    coverage_factor,
    coverage_probability,
    hotelling_factor,
    standard_deviation_interval,
)

# m, k95, k99, P(1), P(2), P(3), P(1.96): chi-squared and normal quantiles, rounded.
TABLE = [
    (1, 1.9600, 2.5758, 0.6827, 0.9545, 0.9973, 0.9500),
    (2, 2.4477, 3.0349, 0.3935, 0.8647, 0.9889, 0.8535),
    (3, 2.7955, 3.3682, 0.1987, 0.7385, 0.9707, 0.7209),
    (6, 3.5485, 4.1002, 0.0144, 0.3233, 0.8264, 0.3019),
]


@pytest.mark.parametrize(("m", "k95", "k99", "p1", "p2", "p3", "p196"), TABLE)
def test_factors_of_a_known_covariance(m, k95, k99, p1, p2, p3, p196):
    computed = [coverage_factor(0.95, m), coverage_factor(0.99, m)]
    computed += [coverage_probability(k, m) for k in (1, 2, 3, 1.96)]
    np.testing.assert_allclose(computed, [k95, k99, p1, p2, p3, p196], atol=5.1e-5)  # printed digits


@pytest.mark.parametrize("m", [1, 2, 3, 6, 29, 999])
@pytest.mark.parametrize("p", [0.01, 0.6827, 0.999, 1 - 1e-12])
def test_chi_factor_and_probability_agree_with_scipy(m, p):
    k = coverage_factor(p, m)
    # 1 - p, which both sides start from, is exact to 1e-16; the quantile gains digits from it, never loses any.
    assert k == pytest.approx(math.sqrt(chdtri(m, 1 - p)), rel=1e-13)
    assert coverage_probability(k, m) == pytest.approx(chdtr(m, k * k), rel=1e-11)
    assert coverage_probability(0.0, m) == 0.0


def test_hotelling_in_the_plane_as_published():
    # GTC (Measurement Standards Laboratory of New Zealand), test/test_reporting.py, calculated there by R 2.9.2.
    dof = [2, 5, 10, 50, math.inf]
    k95 = [28.248893784, 4.166614906, 3.075528764, 2.550142994, 2.447746831]
    k99 = [141.414284993, 6.708203932, 4.222036715, 3.215529821, 3.034854259]
    np.testing.assert_allclose([hotelling_factor(0.95, 2, nu) for nu in dof], k95, rtol=2e-10)
    np.testing.assert_allclose([hotelling_factor(0.99, 2, nu) for nu in dof], k99, rtol=2e-10)
    assert hotelling_factor(0.95, 2, 3) ** 2 == pytest.approx(57.0, rel=1e-13)
    assert hotelling_factor(0.95, 2, 34.3578842438992) == pytest.approx(2.6, rel=1e-13)  # GTC's k2_to_dof(2.6, 95)


@pytest.mark.parametrize(("m", "n", "naive"), [(2, 10, 0.847), (2, 30, 0.924), (3, 10, 0.773), (3, 30, 0.906)])
def test_sample_regions_hold_what_they_promise(m, n, naive):
    trials = 20_000
    rng = np.random.default_rng(7)
    samples = rng.standard_normal((trials, n, m))
    mean = samples.mean(axis=1)
    centred = samples - mean[:, None]
    inverse = np.linalg.inv(np.einsum("tni,tnj->tij", centred, centred) / (n - 1))

    def share(offset, k):
        return np.mean(np.einsum("ti,tij,tj->t", offset, inverse, offset) <= k * k)

    coming = rng.standard_normal((trials, m)) - mean
    noise = 4 * math.sqrt(0.05 * 0.95 / trials)  # four standard deviations of a counted share
    assert share(coming, coverage_factor(0.95, m, n, "prediction")) == pytest.approx(0.95, abs=noise)
    assert share(mean, coverage_factor(0.95, m, n, "mean")) == pytest.approx(0.95, abs=noise)
    # The chi factor with a sample covariance promises too much: Hotelling's distribution says by how much.
    k = coverage_factor(0.95, m)
    exact = fdtr(m, n - m, k * k * (n - m) / (m * (n - 1)) * n / (n + 1))
    assert exact == pytest.approx(naive, abs=3e-3)  # `naive` was itself counted, its noise is 2e-3
    assert share(coming, k) == pytest.approx(exact, abs=4 * math.sqrt(exact * (1 - exact) / trials))


def test_how_well_a_standard_deviation_is_known():
    published = {10: (0.69, 1.83), 30: (0.80, 1.34), 50: (0.84, 1.25), 100: (0.88, 1.16), 1000: (0.96, 1.05)}
    for n, expected in published.items():
        np.testing.assert_allclose(standard_deviation_interval(n), expected, atol=5.1e-3)


@pytest.mark.parametrize(
    "call",
    [
        lambda: coverage_factor(1.0, 2), lambda: coverage_factor(math.nan, 2), lambda: coverage_factor(0.95, 0),
        lambda: coverage_factor(0.95, 3, 3), lambda: coverage_factor(0.95, 3, None, "mean"),
        lambda: hotelling_factor(0.95, 2, math.nan), lambda: standard_deviation_interval(1),
        lambda: Ellipsoid(np.zeros(3), np.eye(3)).points(0.95),
    ],
)  # fmt: skip
def test_impossible_questions_are_refused(call):
    with pytest.raises(po.errors.InputError):
        call()


def rotated(variances, seed=3):
    rng = np.random.default_rng(seed)
    Q, _ = np.linalg.qr(rng.standard_normal((len(variances), len(variances))))
    return Q, Q @ np.diag(variances) @ Q.T


def test_axes_of_an_ellipsoid():
    Q, C = rotated([9.0, 1.0, 4.0])
    ellipsoid = Ellipsoid(np.array([1.0, 2.0, 3.0]), C)
    np.testing.assert_allclose(ellipsoid.semi_axes, [1, 2, 3], rtol=1e-13)
    np.testing.assert_allclose(np.abs(np.sum(ellipsoid.axes * Q[:, [1, 2, 0]], axis=0)), 1, rtol=1e-13)
    assert (ellipsoid.axes[np.abs(ellipsoid.axes).argmax(axis=0), range(3)] > 0).all()
    np.testing.assert_allclose(ellipsoid.region(0.95), np.array([1, 2, 3]) * 2.795483482915108, rtol=1e-12)
    # the lecture's arm at (90, -135) degrees, 1 and 3 degrees, first order: semi-axes and angle of the major axis
    C = np.array([[1.4469104323227898e-3, 1.2576900557348123e-3], [1.2576900557348123e-3, 1.6730870989335434e-3]])
    ellipse = Ellipsoid(np.zeros(2), C)
    np.testing.assert_allclose(ellipse.semi_axes, [0.017240494072445604, 0.05312967998580738], rtol=1e-12)
    np.testing.assert_allclose(ellipse.region(0.95), [0.04220036472520012, 0.130048005800346], rtol=1e-12)
    assert math.degrees(math.atan2(*ellipse.axes[::-1, 1])) == pytest.approx(47.569037523408014, rel=1e-12)


def test_region_holds_its_share_of_the_points_and_so_does_its_projection():
    _, C = rotated([9.0, 1.0, 4.0])
    center = np.array([1.0, 2.0, 3.0])
    points = np.random.default_rng(1).multivariate_normal(center, C, 200_000)
    ellipsoid = Ellipsoid(center, C)
    plane = ellipsoid.project(np.eye(3)[:2])
    line = ellipsoid.project([0.0, 0.6, 0.8])
    noise = 4 * math.sqrt(0.05 * 0.95 / len(points))
    assert ellipsoid.contains(points, 0.95).mean() == pytest.approx(0.95, abs=noise)
    assert plane.contains(points[:, :2], 0.95).mean() == pytest.approx(0.95, abs=noise)
    assert line.contains(points @ np.array([[0.0], [0.6], [0.8]]), 0.95).mean() == pytest.approx(0.95, abs=noise)
    # each projection brings the factor of its own dimension
    assert plane.region(0.95)[1] / plane.semi_axes[1] == pytest.approx(coverage_factor(0.95, 2))
    assert line.region(0.95)[0] / line.semi_axes[0] == pytest.approx(coverage_factor(0.95, 1))


def test_boundary_of_an_ellipse():
    ellipse = Ellipsoid(np.array([5.0, -1.0]), np.array([[2.0, 0.7], [0.7, 0.5]]))
    boundary = ellipse.points(0.9, 181)
    np.testing.assert_allclose(ellipse.mahalanobis(boundary), coverage_factor(0.9, 2), rtol=1e-12)
    assert (boundary[0] == boundary[-1]).all()
    x, y = (boundary - ellipse.center).T
    assert (x[:-1] * y[1:] - x[1:] * y[:-1] > 0).all()  # counter-clockwise throughout
    np.testing.assert_allclose(np.hypot(x[0], y[0]), ellipse.region(0.9)[1], rtol=1e-12)  # from the major axis


@pytest.mark.parametrize("noise", [0.0, 1e-17, -1e-17])
def test_without_full_rank_the_region_lives_in_the_subspace(noise):
    # A planar arm in space, or a singular posture: rounding leaves +-1e-17 where the variance is zero.
    ellipsoid = Ellipsoid(np.zeros(3), np.diag([0.04, 0.01, noise]))
    assert ellipsoid.rank == 2
    np.testing.assert_allclose(ellipsoid.region(0.95)[1:], np.array([0.1, 0.2]) * 2.4477468306808, rtol=1e-12)
    points = [[0.2, 0.1, 0.0], [0.2, 0.1, 1e-3], [0.5, 0.0, 0.0]]
    assert ellipsoid.contains(points, 0.95).tolist() == [True, False, False]
    still = Ellipsoid(np.ones(2), np.zeros((2, 2)))
    assert still.rank == 0
    assert still.region(0.95).tolist() == [0, 0]
    assert still.contains([[1, 1], [1, 1.001]], 0.95).tolist() == [True, False]


def test_small_but_true_variances_are_kept():
    # 1 m and 1 um standard deviation stand side by side in the lecture's singular postures.
    assert Ellipsoid(np.zeros(2), np.diag([1.0, 1e-12])).rank == 2


LINK_SIGMA = 0.01


def arm(x):
    """Tool point of the planar arm; x = a1, a2, theta1, theta2."""
    a1, a2, t1, t2 = x
    return np.array([a1 * np.cos(t1) + a2 * np.cos(t1 + t2), a1 * np.sin(t1) + a2 * np.sin(t1 + t2)])


def expansion(t2, sigma, links=LINK_SIGMA):
    """C1, C2, bias, nominal values and standard deviations of the 2R arm at (90, t2) degrees, by CasADi."""
    x = ca.SX.sym("x", 4)
    f = ca.vertcat(x[0] * ca.cos(x[2]) + x[1] * ca.cos(x[2] + x[3]), x[0] * ca.sin(x[2]) + x[1] * ca.sin(x[2] + x[3]))
    evaluate = ca.Function("f", [x], [ca.jacobian(f, x), *(ca.hessian(f[i], x)[0] for i in range(2))])
    nominal = np.array([1.0, 1.0, math.pi / 2, math.radians(t2)])
    sd = np.array([links, links, math.radians(sigma), math.radians(sigma)])
    J, *H = (value.full() for value in evaluate(nominal))
    S = np.diag(sd**2)
    C2 = np.array([[np.trace(a @ S @ b @ S) / 2 for b in H] for a in H])
    return J @ S @ J.T, C2, np.array([np.trace(a @ S) / 2 for a in H]), nominal, sd


# theta2, sigma [deg], curvature index, coverage of the nominal 95 % first-order ellipse; links 1 m, 10 mm.
CASES = [
    (-90, 5, 0.20, 0.946), (-90, 10, 0.40, 0.933), (-90, 20, 0.81, 0.895), (-10, 3, 0.35, 0.931), (-10, 10, 2.9, 0.636),
    (-10, 20, 7.4, 0.406), (-180, 3, 0.24, 0.944), (-180, 10, 2.6, 0.714), (-180, 20, 10.6, 0.391),
]  # fmt: skip


@pytest.mark.parametrize(("t2", "sigma", "curvature", "coverage"), CASES)
def test_index_and_the_coverage_that_it_warns_of(t2, sigma, curvature, coverage):
    C1, C2, bias, nominal, sd = expansion(t2, sigma)
    validity = Validity.of(C1, C2, bias)
    assert validity.curvature == pytest.approx(curvature, rel=0.03)  # printed to two digits

    n = 100_000
    points = arm((nominal + sd * np.random.default_rng(6).standard_normal((n, 4))).T).T
    counted = Ellipsoid(arm(nominal), C1).contains(points, 0.95).mean()
    assert counted == pytest.approx(coverage, abs=3e-3)  # four standard deviations of the count
    if validity.verdict == "good":
        assert counted > 0.943
    if validity.verdict == "doubtful":
        assert 0.92 < counted < 0.946
    assert (validity.verdict == "wrong") == (counted < 0.92)


@pytest.mark.parametrize("sigma", [1e-3, 0.1, 3])
def test_a_singular_posture_without_link_errors_has_no_first_order(sigma):
    validity = Validity.of(*expansion(-180, sigma, links=0.0)[:3])
    assert math.isinf(validity.curvature)
    assert math.isinf(validity.bias_mahalanobis)
    assert validity.verdict == "wrong"
    assert validity.statement.id == "uncertainty.first-order-singular"
    document = validity.to_json()
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert document["curvature"] is None
    assert document["curvature_infinite"] is True


def test_polar_coordinates_of_jcgm_102():
    # JCGM 102:2011, 9.3: u = 0.010 on both coordinates. At x1 = 0.100 the first order holds, at 0.010 and 0.001 (where
    # it says u(y2) = 10 rad, more than a turn) it does not.
    for x1, verdict in ((0.100, "good"), (0.010, "wrong"), (0.001, "wrong")):
        u2 = 1e-4
        J = np.diag([1.0, 1 / x1])
        H = [np.array([[0, 0], [0, 1 / x1]]), np.array([[0, -1 / x1**2], [-1 / x1**2, 0]])]
        C2 = np.array([[np.trace(a @ b) * u2**2 / 2 for b in H] for a in H])
        validity = Validity.of(u2 * J @ J.T, C2, [np.trace(a) * u2 / 2 for a in H])
        assert validity.verdict == verdict
    assert 2 * math.pi < math.sqrt(u2) * J[1, 1] == pytest.approx(10.0)
