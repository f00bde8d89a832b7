"""Small numerical tools that every room shares, against their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from posture_opt.numerics import factored_columns, thin_svd


def test_long_columns_are_factored_as_by_householder_reflections() -> None:
    A = np.random.default_rng(0).normal(size=(300, 6)) * [1.0, 2.0, 0.01, 5.0, 1.0, 1.0]
    factored = factored_columns(A)
    assert factored is not None
    Q, K = factored
    np.testing.assert_allclose(Q.T @ Q, np.eye(6), atol=1e-14)
    np.testing.assert_allclose(Q @ K, A, atol=1e-13)
    reflected = np.linalg.qr(A)[0]
    np.testing.assert_allclose(Q @ (Q.T @ reflected), reflected, atol=1e-12)


@pytest.mark.parametrize("off", [0.0, 1e-8])
def test_columns_that_may_depend_on_each_other_are_not_factored(off: float) -> None:
    A = np.random.default_rng(0).normal(size=(300, 6))
    A[:, 5] = A[:, 0] - A[:, 1] + off * A[:, 5]
    assert factored_columns(A) is None


def test_singular_vectors_where_divide_and_conquer_does_not_converge(monkeypatch: pytest.MonkeyPatch) -> None:
    A = np.random.default_rng(0).normal(size=(30, 4)) @ np.diag([3.0, 1.0, 1e-15, 0.0])
    expected = np.linalg.svd(A, full_matrices=False)

    def fails(*args: object, **options: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", fails)
    U, s, V = thin_svd(A)
    np.testing.assert_allclose(s, expected[1], atol=1e-14)
    np.testing.assert_allclose((U * s) @ V, A, atol=1e-14)
