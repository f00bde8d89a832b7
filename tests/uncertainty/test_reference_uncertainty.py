"""Published examples of uncertainty evaluation with several outputs: GUM H.2, JCGM 101 and JCGM 102.

"Published" figures are quoted from the public test suites named beside them, which cite the documents. "Exact" ones
were computed to machine precision from the definitions, without any library of uncertainty.
"""

from __future__ import annotations

import functools
import math

import casadi as ca
import numpy as np
import pytest

from posture_opt.uncertainty.regions import coverage_factor
from posture_opt.uncertainty.sampler import adaptive, coverage_factors


def first_order(f, x, covariance):
    """y = f(x) and J C J', J by algorithmic differentiation."""
    symbol = ca.SX.sym("x", len(x))
    y = ca.vertcat(*f(symbol))
    evaluate = ca.Function("f", [symbol], [y, ca.jacobian(y, symbol)])
    value, J = (part.full() for part in evaluate(x))
    return value[:, 0], J @ covariance @ J.T


def deviations(covariance):
    return np.sqrt(np.diag(covariance))


@functools.cache
def additive(third, sigma):
    """JCGM 102:2011, 9.2: Y1 = X1 + X3, Y2 = X2 + X3 by the adaptive procedure, to three digits."""

    def draw(n, rng):
        half = sigma * math.sqrt(3)
        x3 = rng.normal(0, sigma, n) if third == "normal" else rng.uniform(-half, half, n)
        return rng.standard_normal((n, 2)) + x3[:, None]

    return adaptive(draw, digits=3, seed=11, max_blocks=60)


@pytest.mark.parametrize(
    ("third", "sigma", "variance", "r", "kp", "kq"),
    [
        ("normal", 1.0, 2.0, 0.5, 2.448, 2.213),  # 9.2.2
        ("rectangular", 1.0, 2.0, 0.5, 2.381, 2.151),  # 9.2.3
        ("normal", 3.0, 10.0, 0.9, 2.448, 2.108),  # 9.2.4 with a normal
        ("rectangular", 3.0, 10.0, 0.9, 2.283, 1.870),  # and with a rectangular third input
    ],
)
def test_jcgm_102_9_2(third, sigma, variance, r, kp, kq):
    # uncertaintyx, test/gum/jax/test_example_9_2.py; kp and kq from 4e6 trials, known to 0.002
    y, C = first_order(lambda x: (x[0] + x[2], x[1] + x[2]), np.zeros(3), np.diag([1, 1, sigma**2]))
    np.testing.assert_allclose(C, variance * np.array([[1, r], [r, 1]]), rtol=1e-15)
    found = additive(third, sigma)
    assert found.n >= 100_000
    error = 4 / math.sqrt(found.n)
    np.testing.assert_allclose(found.mean, y, atol=error * math.sqrt(variance))
    np.testing.assert_allclose(found.uncertainty, math.sqrt(variance), rtol=error)
    assert found.correlation[0, 1] == pytest.approx(r, abs=error)
    # The quantile's standard error is sqrt(p (1 - p) / n) over the density there, about 0.12: 0.006 at 1e5 trials.
    noise = 0.002 + 4 * math.sqrt(0.05 * 0.95 / found.n) / 0.12
    assert found.kp == pytest.approx(kp, abs=noise)
    assert found.kq == pytest.approx(kq, abs=noise)


def test_a_rectangular_input_makes_the_gaussian_factors_too_large():
    found = additive("rectangular", 3.0)
    assert found.kp < coverage_factor(0.95, 2) - 0.1
    assert found.kq < 2.2414 - 0.3  # Bonferroni for two Gaussian quantities


# r(x), x1, y1, y2, u1, u2, r(y), kp, kq: exact by quadrature; kp and kq from 4e6 trials.
POLAR = [
    (0.0, 0.001, 0.012564454659861, 0.0, 0.006567684454989, 1.744127242439532, 0.0, 2.214, 1.837),
    (0.0, 0.010, 0.015485724605511, 0.0, 0.007758371829337, 1.117546868140146, 0.0, 2.574, 2.380),
    (0.0, 0.100, 0.100501269366774, 0.0, 0.009974710806189, 0.100512661202132, 0.0, 2.452, 2.239),
    (0.9, 0.001, 0.0117328053571, -0.5563123926893, 0.0079587234183, 1.5987870438541, -0.06964998843, 2.320, 2.139),
    (0.9, 0.010, 0.0152890767534, -0.3429272598813, 0.0081390498232, 0.9030801847171, 0.351877398818, 2.460, 2.113),
    (0.9, 0.100, 0.1005090946357, -0.0089855929995, 0.0098955492771, 0.1024096833353, 0.882016986229, 2.479, 2.161),
]
# Published, JCGM 102 tables 6 and 7 by suncal, test/test_examples.py: y1, y2, u1, u2 where quoted there.
PUBLISHED = {
    (0.0, 0.001): (0.013, 0.0, 0.007, 1.744),
    (0.9, 0.001): (0.012, -0.556, 0.008, 1.599),
    (0.9, 0.010): (0.015, -0.343, 0.008, 0.903),
}


@functools.cache
def polar(r, x1):
    """JCGM 102:2011, 9.3: Cartesian to polar coordinates, u = 0.010 on both, x2 = 0."""
    root = 0.010 * np.linalg.cholesky(np.array([[1, r], [r, 1]]))

    def draw(n, rng):
        x = rng.standard_normal((n, 2)) @ root.T + [x1, 0.0]
        return np.column_stack([np.hypot(*x.T), np.arctan2(x[:, 1], x[:, 0])])

    return adaptive(draw, digits=3, seed=12, max_blocks=60)


@pytest.mark.parametrize(("r", "x1", "y1", "y2", "u1", "u2", "ry", "kp", "kq"), POLAR)
def test_jcgm_102_9_3_by_monte_carlo(r, x1, y1, y2, u1, u2, ry, kp, kq):
    found = polar(r, x1)
    # Four standard errors, those of the mean and (times 1.5 for the tails) of a deviation.
    error = 4 / math.sqrt(found.n)
    assert found.mean[0] == pytest.approx(y1, abs=error * u1)
    assert found.mean[1] == pytest.approx(y2, abs=error * u2)
    np.testing.assert_allclose(found.uncertainty, [u1, u2], rtol=1.5 * error)
    assert found.correlation[0, 1] == pytest.approx(ry, abs=1.5 * error)
    noise = 0.003 + 4 * math.sqrt(0.05 * 0.95 / found.n) / 0.1
    assert found.kp == pytest.approx(kp, abs=noise)
    assert found.kq == pytest.approx(kq, abs=noise)
    if (r, x1) in PUBLISHED:
        # Half a unit of the last printed digit, and the error of these trials.
        for value, digit, u, published in zip(
            [*found.mean, *found.uncertainty], [5e-4] * 4, [u1, u2] * 2, PUBLISHED[r, x1], strict=True
        ):
            assert value == pytest.approx(published, abs=1.02 * digit + 1.5 * error * u)


def test_jcgm_101_9_2_sum_of_four():
    # suncal, test_montecarlo: u 2.0; 95 % +-3.92 for normal, +-3.88 for rectangular inputs
    half = math.sqrt(3)
    for draw, end in (
        (lambda n, rng: rng.standard_normal((n, 4)).sum(axis=1, keepdims=True), 3.92),
        (lambda n, rng: rng.uniform(-half, half, (n, 4)).sum(axis=1, keepdims=True), 3.88),
    ):
        found = adaptive(draw, digits=3, seed=13, max_blocks=100)
        assert found.mean[0] == pytest.approx(0, abs=8 / math.sqrt(found.n))
        assert found.uncertainty[0] == pytest.approx(2.0, rel=4 / math.sqrt(found.n))
        assert found.kp == found.kq
        # density of |Y| / 2 at its 95 % point: 0.117
        noise = 0.005 + 2 * 4 * math.sqrt(0.05 * 0.95 / found.n) / 0.117
        assert found.kp * found.uncertainty[0] == pytest.approx(end, abs=noise)


def test_npl_logarithm():
    # NPL DEM-ES-011, 9.2, by suncal, test_NPLlog: y = ln x, x ~ U(0.1, 1.1)
    y, C = first_order(lambda x: (ca.log(x[0]),), np.array([0.6]), np.array([[1 / 12]]))
    assert (y[0], deviations(C)[0]) == (pytest.approx(-0.511, abs=5e-4), pytest.approx(0.481, abs=5e-4))
    found = adaptive(lambda n, rng: np.log(rng.uniform(0.1, 1.1, (n, 1))), digits=3, seed=14)
    # Exact, by parts: mean = 1.1 ln 1.1 - 0.1 ln 0.1 - 1.
    assert 1.1 * math.log(1.1) - 0.1 * math.log(0.1) - 1 == pytest.approx(-0.665, abs=5e-4)
    noise = 4 / math.sqrt(found.n)
    assert found.mean[0] == pytest.approx(-0.665, abs=5e-4 + noise * 0.606)
    assert found.uncertainty[0] == pytest.approx(0.606, abs=5e-4 + noise * 0.606)


def test_coverage_factors_of_gaussian_trials_are_those_of_the_tables():
    rng = np.random.default_rng(15)
    for m, sidak in ((1, 1.9600), (2, 2.2365), (3, 2.3877), (6, 2.6310)):
        kp, kq = coverage_factors(rng.standard_normal((200_000, m)))
        assert kp == pytest.approx(coverage_factor(0.95, m), abs=0.02)  # four standard errors of the quantile
        assert kq == pytest.approx(sidak, abs=0.02)
