"""Correlated sources as independent ones and shared factors: Σ = D + L Lᵀ, as few factors as can be."""

from __future__ import annotations

import numpy as np
import pytest

from posture_opt.uncertainty.integration import SharedFactors


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


@pytest.mark.parametrize("rho", [0.8, -0.3, 1.0, -1.0, 1e-9])
def test_a_pair_shares_one_factor(rho):
    S = np.array([[4.0, 0.0, 6e-3 * rho], [0.0, 1.0, 0.0], [6e-3 * rho, 0.0, 9e-6]])  # radians and millimetres
    found = split(S)
    assert found.count == 1
    np.testing.assert_allclose(found.own, [4 * (1 - abs(rho)), 1, 9e-6 * (1 - abs(rho))], atol=1e-15)


@pytest.mark.parametrize("rho", [0.8, 0.01, 0.999, 1.0])
@pytest.mark.parametrize("k", [3, 6, 12])
def test_equal_correlations_share_one_factor(k, rho):
    found = split(np.full((k, k), rho) + (1 - rho) * np.eye(k))
    assert found.count == 1
    np.testing.assert_allclose(found.own, 1 - rho, atol=1e-9)


@pytest.mark.parametrize(("k", "rank"), [(6, 1), (8, 2), (10, 3)])
def test_factors_that_were_put_in_are_found(k, rank):
    rng = np.random.default_rng(3)
    assert split(correlations(rng, k, rank)).count == rank
    assert split(correlations(rng, k, rank, own=0.6)).count == rank


@pytest.mark.parametrize("seed", range(20))
def test_any_covariance_of_any_rank_is_split(seed):
    rng = np.random.default_rng(seed)
    k = int(rng.integers(2, 16))
    R = correlations(rng, k, int(rng.integers(1, 2 * k)))
    sigma = 10.0 ** rng.uniform(-9, 0, k)
    found = split(R * np.outer(sigma, sigma))
    assert found.count <= max(1, k - 1)
    # No diagonal of a larger sum was missed: that of the smallest eigenvalue is one that is allowed.
    assert (found.own / sigma**2).sum() >= k * np.linalg.eigvalsh(R)[0] - 1e-9


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("faint", [1e-4, 1e-6, 1e-8, 1e-11])
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
