"""The 95 % distance in space against the chi distribution, a noncentral one, and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, ncx2

from posture_opt.uncertainty.clearance import radius_in_space


def test_isotropic_is_the_chi_quantile() -> None:
    assert radius_in_space(0.95, 4.0 * np.eye(3), np.zeros(3)) == pytest.approx(
        2 * np.sqrt(chi2.ppf(0.95, 3)), rel=1e-9
    )


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
