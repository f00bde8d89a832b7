"""Coverage factors against published tables and SciPy; ellipsoids against geometry and Monte Carlo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import chdtr, chdtri, fdtr

import posture_opt as po
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


@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 6, 7, 29, 50, 999])
@pytest.mark.parametrize("p", [0.01, 0.1, 0.5, 0.6827, 0.95, 0.999, 1 - 1e-12])
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
        lambda: coverage_factor(1.0, 2),
        lambda: coverage_factor(0.0, 2),
        lambda: coverage_factor(math.nan, 2),
        lambda: coverage_factor(0.95, 0),
        lambda: coverage_factor(0.95, 3, 3),
        lambda: coverage_factor(0.95, 3, None, "mean"),
        lambda: hotelling_factor(0.95, 2, math.nan),
        lambda: standard_deviation_interval(1),
        lambda: Ellipsoid(np.zeros(3), np.eye(3)).points(0.95),
    ],
)
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
