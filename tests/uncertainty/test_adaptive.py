"""The adaptive Monte Carlo procedure: its rules by hand, its promise on models whose answer is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

import posture_opt as po
from posture_opt.uncertainty.sampler import adaptive


def additive(rng, n):
    """Y1 = X1 + X3, Y2 = X2 + X3 with standard normal X: variances 2, correlation 0.5 (JCGM 102:2011, 9.2.2)."""
    x = rng.standard_normal((n, 3))
    return x[:, :2] + x[:, 2:]


def draw_additive(n, rng):
    return additive(rng, n)


def test_a_gaussian_model_is_stable_at_once_and_agrees_with_the_closed_form():
    found = adaptive(draw_additive, seed=1)
    assert found.stable
    assert (found.blocks, found.n) == (10, 100_000)
    error = 4 / math.sqrt(found.n)
    np.testing.assert_allclose(found.mean, 0, atol=error * math.sqrt(2))
    np.testing.assert_allclose(found.covariance, [[2, 1], [1, 2]], atol=error * 2 * math.sqrt(2))
    np.testing.assert_allclose(found.uncertainty, math.sqrt(2), rtol=error)
    assert found.kp == pytest.approx(2.4477, abs=0.02)  # the quantile of 1e5 trials: its standard error is 0.006
    np.testing.assert_array_equal(found.tolerances.mean, 0.05)  # u = 1.4: half a unit of the second digit
    assert found.tolerances.coverage_factor == 0.05
    assert found.reached.within(found.tolerances)


def test_quantities_that_do_not_vary():
    found = adaptive(lambda n, rng: np.column_stack([rng.standard_normal(n), np.full(n, 7.0)]))
    assert found.stable
    np.testing.assert_array_equal(found.uncertainty[1], 0.0)
    np.testing.assert_array_equal(found.correlation, np.eye(2))
    assert found.kp == pytest.approx(1.96, abs=0.02)  # the region has one dimension
    still = adaptive(lambda n, rng: np.zeros((n, 2)))
    assert still.stable
    assert (still.kp, still.kq) == (0.0, 0.0)


@pytest.mark.parametrize(
    "call",
    [
        lambda: adaptive(draw_additive, p=1.0),
        lambda: adaptive(draw_additive, digits=0),
        lambda: adaptive(draw_additive, max_blocks=3),
        lambda: adaptive(lambda n, rng: np.zeros(n)),
        lambda: adaptive(lambda n, rng: np.zeros((n - 1, 2))),
        lambda: adaptive(lambda n, rng: np.full((n, 2), math.nan)),
    ],
)
def test_impossible_input_is_refused(call):
    with pytest.raises(po.errors.InputError):
        call()
