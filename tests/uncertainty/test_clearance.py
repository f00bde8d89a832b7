"""The clearance probability and the 95 % distance against SciPy's distributions, integrals, sampling and limits."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import log_ndtr, ndtr
from scipy.stats import ncx2

import posture_opt as po
from posture_opt.uncertainty.clearance import (
    log_miss_probability,
    miss_probability,
    radius_for,
    radius_in_space,
    success_probability,
    within_clearance,
)

SKEW = np.array([[2.0, 0.8], [0.8, 0.6]])


def by_strips(sigma, bias, r):
    """The same probability conditioned on the minor axis: one integral over normal tails, in Cartesian terms."""

    def strip(t):
        y, h = r * math.sin(t), r * math.cos(t)
        outside = ndtr((-h - bias[0]) / sigma[0]) + ndtr((bias[0] - h) / sigma[0])
        return outside * math.exp(-(((y - bias[1]) / sigma[1]) ** 2) / 2) / (sigma[1] * math.sqrt(2 * math.pi)) * h

    near = {max(-1.0, min(1.0, (bias[1] + k * sigma[1]) / r)) for k in (-20, -8, -4, -2, 0, 2, 4, 8, 20)}
    breaks = [math.asin(x) for x in sorted(near | {-1.0, 1.0})]
    inner = sum(quad(strip, a, b, epsabs=0, epsrel=1e-13, limit=400)[0] for a, b in itertools.pairwise(breaks))
    return inner + ndtr((-r - bias[1]) / sigma[1]) + ndtr((bias[1] - r) / sigma[1])


@pytest.mark.parametrize("sigma", [10.0, 1.0, 0.1, 0.02])
@pytest.mark.parametrize("distance", [0.0, 1e-9, 0.99, 1.0001, 4.0])
def test_isotropic_with_bias_is_noncentral_chi_squared(sigma, distance):
    computed = log_miss_probability(sigma**2 * np.eye(2), 1.0, [0.6 * distance, 0.8 * distance])
    expected = ncx2.logsf(1 / sigma**2, 2, (distance / sigma) ** 2) if distance else -1 / (2 * sigma**2)
    if math.isinf(expected):
        assert computed < -500  # where SciPy's tail underflows
        return
    # SciPy's series is good to about 1e-12 of the probability.
    assert math.expm1(computed - expected) == pytest.approx(0, abs=1e-11)


@pytest.mark.filterwarnings("ignore::scipy.integrate.IntegrationWarning")  # asked for more digits than there are
@pytest.mark.parametrize("ratio", [0.3, 1e-4])
@pytest.mark.parametrize("sigma", [20.0, 0.1])
@pytest.mark.parametrize("distance", [0.0, 0.999, 1.8])
def test_ellipse_and_bias_of_any_direction_agree_with_integration_by_strips(ratio, sigma, distance):
    axes = (sigma, ratio * sigma)
    for angle in (0.0, 0.4, math.pi / 2, 2.5):
        bias = np.array([distance * math.cos(angle), distance * math.sin(angle)])
        expected = by_strips(axes, bias, 1.0)
        # The quadratures ask 1e-12 of themselves; near the rim the rounding of the input, 1e-16 / sigma, shows.
        assert miss_probability(np.diag(axes) ** 2, 1.0, bias) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("bias", [(0.0, 0.0), (0.9, -0.5), (2.5, 1.0)])
def test_against_a_million_samples(bias):
    n = 1_000_000
    points = np.random.default_rng(5).multivariate_normal(bias, SKEW, n)
    counted = np.mean(np.hypot(*points.T) > 2.0)
    p = miss_probability(SKEW, 2.0, bias)
    assert counted == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / n))  # four standard deviations of a count


@pytest.mark.parametrize(("sigma", "bias"), [(0.5, 0.0), (0.01, 0.3), (0.4, 1.7), (3.0, 1.0)])
def test_on_a_line_it_is_two_normal_tails(sigma, bias):
    expected = np.logaddexp(log_ndtr((-1 - bias) / sigma), log_ndtr((bias - 1) / sigma))
    for covariance, b in (
        ([[sigma**2]], [bias]),
        (np.diag([sigma**2, 0.0]), [bias, 0.0]),
        (np.diag([0.0, sigma**2]), [0.0, bias]),
    ):
        assert log_miss_probability(covariance, 1.0, b) == pytest.approx(expected, rel=1e-12, abs=1e-13)


def test_a_singular_covariance_with_bias_across_it():
    # The line passes the circle's centre at 0.6, so that 0.8 of play is left along it; at 1.2 it passes by.
    along = np.array([[0.36, 0.48], [0.48, 0.64]])  # standard deviation 1 along (0.6, 0.8)
    across = np.array([-0.8, 0.6])
    # Rounding leaves the second eigenvalue at some 1e-17, a standard deviation of 1e-8 across the line.
    assert miss_probability(along, 1.0, 0.6 * across) == pytest.approx(2 * ndtr(-0.8), rel=1e-12)
    assert miss_probability(along, 1.0, 1.2 * across) == 1.0
    assert success_probability(along, 1.0, 1.2 * across + 0.1) == 0.0


def test_without_scatter_the_bias_decides():
    assert miss_probability(np.zeros((2, 2)), 1.0, [0.6, 0.7]) == 0.0
    assert miss_probability(np.zeros((2, 2)), 1.0, [0.8, 0.7]) == 1.0
    assert log_miss_probability(np.zeros((2, 2)), 1.0) == -math.inf
    assert radius_for(0.95, np.zeros((2, 2)), [3.0, 4.0]) == 5.0


def test_no_clearance_and_all_clearance():
    assert miss_probability(SKEW, 0.0, [0.1, 0.2]) == 1.0
    assert miss_probability(SKEW, 0.0) == 1.0
    assert miss_probability(SKEW, math.inf) == 0.0


def test_rare_misses_keep_their_digits():
    # 1e-30 and far below: Rayleigh's distribution, and along a line the tails of the normal one.
    assert miss_probability(np.eye(2), math.sqrt(60 * math.log(10))) == pytest.approx(1e-30, rel=1e-12)
    assert log_miss_probability(np.eye(2) * 1e-12, 0.2e-3) == pytest.approx(-(200**2) / 2, rel=1e-13)
    expected = math.log(2) + log_ndtr(-500.0)
    assert log_miss_probability([[1.0]], 500.0) == pytest.approx(expected, rel=1e-13)
    # The lesser axis at a tenth changes the far tail by 1/sqrt(1 - 0.01) only (Laplace's method, first order).
    thin = log_miss_probability(np.diag([1.0, 0.01]), 500.0)
    assert thin - expected == pytest.approx(-math.log(1 - 0.01) / 2, rel=1e-3)
    # With bias: far out a circle is a straight edge, up to the focusing factor sqrt(r / b) (Laplace again).
    biased = log_miss_probability(np.eye(2), 1000.0, [600.0, 0.0])
    assert biased == pytest.approx(log_ndtr(-400.0) + math.log(1000 / 600) / 2, rel=1e-6)


def test_success_keeps_its_digits_when_it_is_rare():
    # A hole much smaller than the scatter: density times area.
    r = 1e-5
    expected = r * r / 2 / math.sqrt(np.linalg.det(SKEW))
    assert success_probability(SKEW, r) == pytest.approx(expected, rel=1e-5)  # 1 - P leaves 1e-16 of 1e-10


def test_radius_of_known_regions():
    assert radius_for(0.95, np.eye(2)) == pytest.approx(2.447746830680816, rel=1e-13)  # sqrt(-2 ln 0.05)
    assert radius_for(0.5, np.eye(2)) == pytest.approx(1.1774100225154747, rel=1e-13)  # circular error probable
    assert radius_for(0.95, [[4.0]]) == pytest.approx(2 * 1.959963984540054, rel=1e-13)
    # mean + 3 s of the distance, the repeatability of ISO 9283, in the plane and on a line
    assert radius_for(0.99437, np.eye(2)) == pytest.approx(3.21872, abs=3e-4)
    assert radius_for(0.99085, np.diag([1.0, 0.0])) == pytest.approx(2.60632, abs=3e-4)


@pytest.mark.parametrize("p", [1e-6, 0.95, 1 - 1e-9])
@pytest.mark.parametrize("bias", [(0.0, 0.0), (3.0, 4.0)])
@pytest.mark.parametrize("covariance", [SKEW, np.diag([1.0, 1e-6]), np.diag([1.0, 0.0]), 1e-10 * np.eye(2)])
def test_radius_inverts_the_probability(p, bias, covariance):
    radius = radius_for(p, covariance, bias)
    # Where the probability is steep in r, r's own rounding shows in it: the root is asked for to 1e-14 of r.
    above = miss_probability(covariance, radius * (1 - 1e-14), bias)
    below = miss_probability(covariance, radius * (1 + 1e-14), bias)
    assert above * (1 + 1e-12) >= 1 - p >= below * (1 - 1e-12)


@pytest.mark.parametrize(
    "call",
    [
        lambda: miss_probability(np.eye(3), 1.0), lambda: miss_probability(np.eye(2), 1.0, [0.0]),
        lambda: miss_probability(np.eye(2), -1.0), lambda: miss_probability(np.eye(2), math.nan),
        lambda: miss_probability([[math.nan, 0], [0, 1]], 1.0),
        lambda: miss_probability(np.eye(2), 1.0, [math.inf, 0.0]), lambda: radius_for(1.0, np.eye(2)),
    ],
)  # fmt: skip
def test_impossible_questions_are_refused(call):
    with pytest.raises(po.errors.InputError):
        call()


@pytest.mark.parametrize("distance", [0.0, 0.7, 2.5])
@pytest.mark.parametrize("clearance", [0.5, 1.0, 3.0])
def test_in_space_the_clearance_is_a_ball(clearance: float, distance: float) -> None:
    """Against the noncentral χ² of a round spread; outside of the ball rays touch it, which costs digits."""
    bias = distance * np.array([0.6, 0.0, 0.8])
    expected = ncx2(3, distance**2 or 1e-12).cdf(clearance**2)
    found = within_clearance(np.eye(3), clearance, bias)
    assert found == pytest.approx(expected, rel=1e-9 if distance < clearance else 1e-2)


def test_in_space_a_long_spread_is_that_of_sampling() -> None:
    rng = np.random.default_rng(0)
    A = rng.normal(size=(3, 3)) * [1.0, 0.3, 0.05]
    C, bias = A.T @ A, np.array([0.1, 0.2, -0.1])
    drawn = rng.multivariate_normal(bias, C, 400_000)
    for clearance in (0.5, 1.0, 2.0):
        hit = float((np.linalg.norm(drawn, axis=1) <= clearance).mean())
        assert within_clearance(C, clearance, bias) == pytest.approx(hit, abs=4 * np.sqrt(0.25 / len(drawn)))
    assert within_clearance(np.zeros((3, 3)), 1.0, np.zeros(3)) == 1.0


def test_isotropic_with_bias_is_the_noncentral_quantile() -> None:
    bias = np.array([0.3, -0.8, 1.1])
    expected = np.sqrt(ncx2.ppf(0.95, 3, float(bias @ bias)))
    assert radius_in_space(0.95, np.eye(3), bias) == pytest.approx(expected, rel=1e-6)


def test_a_line_in_space_is_the_normal_quantile() -> None:
    # Rank one: the mean over the sphere has a kink at the equator, and the product rule keeps four digits.
    direction = np.array([1.0, 2.0, -2.0]) / 3
    assert radius_in_space(0.95, np.outer(direction, direction), np.zeros(3)) == pytest.approx(1.959964, rel=2e-3)


@pytest.mark.parametrize("sigmas", [(1.0, 0.5, 0.2), (1.0, 0.9, 0.01), (1.0, 0.05, 0.05)])
def test_general_is_that_of_a_cloud(sigmas: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(2)
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    C, bias = Q @ np.diag(np.square(sigmas)) @ Q.T, np.array([0.1, 0.2, -0.1])
    points = rng.multivariate_normal(bias, C, 400_000)
    inside = np.mean(np.linalg.norm(points, axis=1) <= radius_in_space(0.95, C, bias))
    # Five standard errors of a proportion of 0.95 from that many draws.
    assert abs(inside - 0.95) < 5 * np.sqrt(0.95 * 0.05 / len(points))
