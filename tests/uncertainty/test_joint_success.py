"""The probability that all places succeed, against plain sampling and against what is known in closed form."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from scipy.stats import chi2, norm

from posture_opt.uncertainty.clearance import success_probability
from posture_opt.uncertainty.success_of_all import PlaceErrors, success_of_all
from tests.helpers.variants import conformance


def drawn(seed: int, K: int, rank: int, scatter: float) -> list[PlaceErrors]:
    rng = np.random.default_rng(seed)
    return [
        PlaceErrors(
            0.1 * rng.normal(size=2),
            0.3 * rng.normal(size=(2, rank)) / math.sqrt(rank),
            scatter * np.diag(rng.uniform(0.01, 0.1, 2)),
            1.0,
        )
        for _ in range(K)
    ]


def sampled(places: list[PlaceErrors], n: int) -> tuple[float, float]:
    """By plain Monte Carlo, with its standard error."""
    rng = np.random.default_rng(5)
    delta, hit = rng.standard_normal((n, places[0].shared.shape[1])), np.ones(n, dtype=bool)
    for place in places:
        scatter = rng.multivariate_normal(np.zeros(len(place.bias)), place.scatter, n)
        hit &= np.linalg.norm(place.bias + delta @ place.shared.T + scatter, axis=1) <= place.clearance
    return float(hit.mean()), math.sqrt(hit.mean() * (1 - hit.mean()) / n)


@pytest.mark.parametrize(
    ("K", "rank", "scatter"),
    conformance([*product([2, 10], [1, 6], [0.0, 1.0]), (4, 20, 0.3)], [(2, 1, 1.0), (2, 6, 0.0)]),
)
def test_against_plain_sampling(K: int, rank: int, scatter: float) -> None:
    places = drawn(100 * K + rank, K, rank, scatter)
    found, (p, error) = success_of_all(places), sampled(places, 200_000)
    # 36 cases: one in 400 of them lies beyond 4 standard errors by chance.
    assert abs(found.probability - p) < 4 * math.hypot(error, found.standard_error) + 1e-6
    assert found.standard_error < 2e-3


def test_scatter_alone_is_the_product_exactly() -> None:
    places = [PlaceErrors(np.array([0.1, 0.0]), np.zeros((2, 0)), np.diag([0.04, 0.09]), c) for c in (0.5, 0.7, 1.0)]
    found = success_of_all(places)
    expected = math.prod(success_probability(p.scatter, p.clearance, p.bias) for p in places)
    assert found.probability == pytest.approx(expected, rel=1e-12)
    assert found.standard_error == 0


def test_one_place_is_its_own_probability_exactly() -> None:
    place = drawn(3, 1, 4, 0.5)[0]
    expected = success_probability(place.shared @ place.shared.T + place.scatter, 1.0, place.bias)
    assert success_of_all([place]).probability == pytest.approx(expected, rel=1e-12)


def test_equal_places_under_one_draw_are_one_place() -> None:
    """A circular Gaussian: chi-squared with two degrees of freedom, however many places share it."""
    place = PlaceErrors(np.zeros(2), 0.4 * np.eye(2), np.zeros((2, 2)), 1.0)
    found = success_of_all([place] * 5)
    assert found.probability == pytest.approx(chi2(2).cdf(1 / 0.4**2), abs=1e-9)
    assert found.product == pytest.approx(found.probability**5, rel=1e-9)


def test_one_shared_error_across_is_an_interval() -> None:
    """Two places shifted by one normal number: both succeed where it lies in both intervals."""
    first = PlaceErrors(np.array([0.2]), np.array([[0.5]]), np.zeros((1, 1)), 1.0)
    second = PlaceErrors(np.array([-0.1]), np.array([[-0.8]]), np.zeros((1, 1)), 1.0)
    low, high = max(-1.2 / 0.5, -1.1 / 0.8), min(0.8 / 0.5, 0.9 / 0.8)
    assert success_of_all([first, second]).probability == pytest.approx(norm.cdf(high) - norm.cdf(low), rel=1e-9)
