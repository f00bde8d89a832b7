"""Optimal experiments by exchange, against all subsets of small sets and against designs known in closed form."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from posture_opt.experiments.exchange import (
    Criterion,
    Determinant,
    Variance,
    exchange_design,
)


def value(A: np.ndarray, M0: np.ndarray, chosen: np.ndarray, L: np.ndarray | None) -> float:
    """log det or trace(L C Lᵀ) by the plain definition."""
    M = M0 + sum(A[i].T @ A[i] for i in chosen)
    if np.linalg.matrix_rank(M) < len(M):
        return np.inf
    C = np.linalg.inv(M)
    return float(np.log(np.linalg.det(C)) if L is None else np.trace(L @ C @ L.T))


@pytest.mark.parametrize(("task", "block", "known"), [(False, 1, False), (True, 2, True)])
def test_no_subset_of_a_small_set_is_better(task: bool, block: int, known: bool) -> None:
    found = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        A = rng.normal(size=(12, block, 4)) * [1.0, 1e3, 1e-2, 1.0]  # units differ as degrees and metres do
        M0 = np.diag([1.0, 1e5, 1e-5, 0.5]) if known else np.zeros((4, 4))
        L = rng.normal(size=(2, 4)) * [1.0, 1e3, 1e-2, 1.0] if task else None
        criterion: Criterion = Determinant() if L is None else Variance(L)
        design = exchange_design(A, M0, criterion, 5, starts=6, seed=seed)
        mine = value(A, M0, design.chosen, L)
        best = min(value(A, M0, np.array(subset), L) for subset in combinations(range(12), 5))
        assert len(set(design.chosen)) == 5
        assert mine >= best - 1e-9
        found += mine <= best + 1e-6 * max(1.0, abs(best))
    assert found >= 9  # exchange is a local search: of ten small sets it may miss one


# The D-optimal points of polynomial regression on [-1, 1] are ±1 and the extrema of Legendre's polynomial (Guest 1958).
GUEST = {2: [-1, 0, 1], 3: [-1, -np.sqrt(1 / 5), np.sqrt(1 / 5), 1], 4: [-1, -np.sqrt(3 / 7), 0, np.sqrt(3 / 7), 1]}


@pytest.mark.parametrize("degree", GUEST)
def test_polynomials_are_measured_at_the_points_of_legendre(degree: int) -> None:
    grid = np.linspace(-1, 1, 401)
    A = np.vander(grid, degree + 1)[:, None, :]
    design = exchange_design(A, np.zeros((degree + 1,) * 2), Determinant(), 2 * (degree + 1), replicate=True)
    off = np.abs(grid[design.chosen][:, None] - np.array(GUEST[degree]))
    assert off.min(axis=1).max() < 0.005  # a step of the grid: between two of its points both may be taken
    assert list(np.bincount(off.argmin(axis=1))) == [2] * (degree + 1)  # every point as often as the others


def test_an_extrapolated_line_is_measured_mostly_at_the_near_end() -> None:
    grid = np.linspace(-1, 1, 41)
    A = np.column_stack([np.ones(41), grid])[:, None, :]
    x = 2.0
    design = exchange_design(A, np.zeros((2, 2)), Variance(np.array([[1.0, x]])), 8, replicate=True)
    points, times = np.unique(grid[design.chosen], return_counts=True)
    # Hoel, Levine (1964): shares (x ± 1) / 2x at ±1, and the variance x² / n.
    assert list(points) == [-1.0, 1.0]
    assert list(times) == [2, 6]
    assert value(A, np.zeros((2, 2)), design.chosen, np.array([[1.0, x]])) == pytest.approx(x**2 / 8, rel=1e-12)
