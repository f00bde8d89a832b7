"""Joint and instrument scatter from errors: against brute force, and with errors as large as stated."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from posture_opt.validation.joint_variances import estimate_joint_variances
from posture_opt.validation.scatter_model import Scatter

SIGMA = np.array([1e-3, 3e-3])
NOISE = 5e-4


def planar(q: np.ndarray) -> np.ndarray:
    """Columns (N, 2, 2) of a planar arm with links of 1 m: its tool point turned about each joint."""
    first = np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])], axis=1)
    second = np.stack([np.cos(q.sum(axis=1)), np.sin(q.sum(axis=1))], axis=1)
    turned = [np.stack([-p[:, 1], p[:, 0]], axis=1) for p in (first + second, second)]
    return np.stack(turned, axis=2)


def visits(
    rng: np.random.Generator, poses: int, repeats: int, sigma: np.ndarray = SIGMA, noise: float = NOISE
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors about unknown means, columns and groups."""
    J = planar(rng.uniform(-2.5, 2.5, (poses, 2))).repeat(repeats, axis=0)
    groups = np.arange(poses).repeat(repeats)
    errors = np.einsum("ndk,nk->nd", J, sigma * rng.normal(size=(len(J), 2))) + noise * rng.normal(size=(len(J), 2))
    return errors + rng.normal(0, 0.01, (poses, 2))[groups], J, groups


def brute(errors: np.ndarray, J: np.ndarray, groups: np.ndarray | None, theta: np.ndarray) -> float:
    """Restricted log-likelihood from the full covariance and a matrix of contrasts, by its definition."""
    n, d = errors.shape
    V = np.zeros((n * d, n * d))
    for i, columns in enumerate(J):
        V[i * d : i * d + d, i * d : i * d + d] = columns @ np.diag(theta[:-1]) @ columns.T + theta[-1] * np.eye(d)
    if groups is not None:
        X = np.kron((groups[:, None] == np.unique(groups)).astype(float), np.eye(d))
        K = np.linalg.svd(X)[0][:, X.shape[1] :]
        V, y = K.T @ V @ K, K.T @ errors.ravel()
    else:
        y = errors.ravel()
    return float(-0.5 * (np.linalg.slogdet(2 * np.pi * V)[1] + y @ np.linalg.solve(V, y)))


@pytest.mark.parametrize("grouped", [True, False])
def test_the_likelihood_is_as_high_as_brute_force_gets(grouped: bool) -> None:
    rng = np.random.default_rng(1)
    errors, J, groups = visits(rng, 6, 4)
    if not grouped:
        errors = errors - np.array([errors[groups == g].mean(axis=0) for g in groups])
    codes = groups if grouped else None
    found = estimate_joint_variances(errors, J, groups=codes, instrument=1e-3, fit_instrument=True)
    theta = np.array([*found.sigma**2, found.instrument**2])
    # The constant of the likelihood counts too: models are compared by it.
    assert found.log_likelihood == pytest.approx(brute(errors, J, codes, theta), abs=1e-6)
    reference = minimize(
        lambda x: -brute(errors, J, codes, np.exp(x)), np.log([1e-6, 1e-6, 1e-6]), method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-9, "maxiter": 4000},
    )  # fmt: skip
    assert found.log_likelihood >= -reference.fun - 1e-6
    # Nelder-Mead stops at 1e-6 in the logarithm of a variance; the likelihood is flat to its root there.
    np.testing.assert_allclose(theta, np.exp(reference.x), rtol=1e-3)


def test_standard_errors_are_those_of_the_information_by_differences() -> None:
    errors, J, groups = visits(np.random.default_rng(2), 60, 5)
    found = estimate_joint_variances(errors, J, groups=groups, instrument=1e-3, fit_instrument=True)
    scatter = Scatter.of(errors, J, groups)
    at = np.array([*found.sigma, found.instrument])

    def value(x: np.ndarray) -> float:
        V = np.einsum("gik,k,gjk->gij", scatter.columns, x[:2] ** 2, scatter.columns) + x[2] ** 2 * np.eye(2)
        return float(scatter.log_likelihoods(V).sum())

    h = 1e-3 * at
    E = np.diag(h)
    hessian = np.array(
        [[value(at + a + b) - value(at + a - b) - value(at - a + b) + value(at - a - b) for b in E] for a in E]
    ) / (4 * np.outer(h, h))
    observed = np.sqrt(np.diag(np.linalg.inv(-hessian)))
    # Observed and expected information agree to about 1/sqrt(480 coordinates) of themselves.
    np.testing.assert_allclose([*found.std, found.instrument_std], observed, rtol=0.15)


@pytest.mark.campaign
def test_intervals_of_95_percent_hold_the_truth_in_95_percent_of_300_draws() -> None:
    rng = np.random.default_rng(3)
    held = np.zeros(3)
    for _ in range(300):
        errors, J, groups = visits(rng, 12, 4)
        found = estimate_joint_variances(errors, J, groups=groups, instrument=1e-3, fit_instrument=True)
        ends = np.array([*found.interval, found.instrument_interval])
        truth = np.array([*SIGMA, NOISE])
        held += (ends[:, 0] <= truth) & (truth <= ends[:, 1])
    # Binomial: 285 ± 3.8 of 300; 92 % and 98 % are 276 and 294.
    assert np.all((held >= 276) & (held <= 294)), held


@pytest.mark.campaign
def test_a_joint_without_scatter_stays_at_zero_and_its_bound_holds() -> None:
    rng = np.random.default_rng(4)
    at_zero, held = 0, 0
    for _ in range(100):
        errors, J, groups = visits(rng, 12, 4, np.array([0.0, 3e-3]))
        found = estimate_joint_variances(errors, J, groups=groups, instrument=NOISE)
        assert np.all(found.sigma >= 0)
        at_zero += found.sigma[0] == 0
        held += found.interval[0, 0] == 0
        assert found.std[0] > 0
        assert found.instrument == NOISE
        assert found.instrument_std == 0
    # At the edge half of the estimates are zero, and half a likelihood's 5 % are above: 50 ± 5 and 97.5 ± 1.6.
    assert 35 <= at_zero <= 65
    assert held >= 93
