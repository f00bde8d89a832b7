"""Closed forms and factors of a search against NumPy's dense answers."""

from __future__ import annotations

import numpy as np
import pytest

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.lack_of_fit import SmoothKernel
from posture_opt.diagnosis.scores.projected_scores import explained_squares, row_products
from posture_opt.diagnosis.scores.score_tests import orthonormal_basis

RNG = np.random.default_rng(12)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_what_columns_explain_is_what_their_clear_directions_do(k: int) -> None:
    columns = RNG.normal(size=(500, 6, k)) / 3
    columns[:250, :, -1] = columns[:250, :, 0] + columns[:250, :, -1] * 10 ** RNG.uniform(-4, 0, (250, 1))
    columns[:10] = 0.0
    gram, score = np.swapaxes(columns, 1, 2) @ columns, RNG.normal(size=(500, k))
    values, vectors = np.linalg.eigh(gram)
    clear = values > levels.MIN_DISTINCT_SHARE
    parts = np.einsum("ikl,ik->il", vectors, score) ** 2
    gains, counts = explained_squares(gram, score)
    np.testing.assert_array_equal(counts, clear.sum(axis=1))
    np.testing.assert_allclose(gains, np.sum(np.where(clear, parts / np.where(clear, values, 1), 0), axis=1), rtol=1e-7)


@pytest.mark.parametrize("k", [1, 2, 5])
def test_products_of_rows_are_those_of_matrices(k: int) -> None:
    rows = RNG.normal(size=(3, 7, k, 2))
    np.testing.assert_allclose(row_products(rows), rows @ np.swapaxes(rows, 2, 3), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("directions", [1, 3])
def test_a_smooth_kernel_gives_the_quadratic_forms_of_its_dense_matrix(directions: int) -> None:
    x, sides = RNG.uniform(-1, 1, (300, directions)), RNG.choice([-1.0, 0.0, 1.0], 300)
    dense = np.exp(-0.5 * np.sum((x[:, None] - x[None]) ** 2, axis=2)) * np.outer(sides, sides)
    e = RNG.normal(size=(300, 20))
    np.testing.assert_allclose(
        SmoothKernel(x, sides).smoothed(e).sum(axis=0), np.sum(e * (dense @ e), axis=0), rtol=1e-9
    )


@pytest.mark.parametrize("nearly", [1e-2, 1e-6, 0.0])
def test_a_basis_spans_its_columns_and_is_orthonormal(nearly: float) -> None:
    columns = RNG.normal(size=(200, 6)) * [1, 1e3, 1e-3, 1, 1, 0]
    columns[:, 4] = columns[:, 0] + nearly * RNG.normal(size=200)
    Q = orthonormal_basis(columns)
    assert Q.shape == (200, 5 if nearly else 4)
    np.testing.assert_allclose(Q.T @ Q, np.eye(Q.shape[1]), atol=1e-12)
    unit = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    np.testing.assert_allclose(Q @ (Q.T @ unit), unit, atol=1e-9)
