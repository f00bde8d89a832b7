"""L D Lᵀ written out: against NumPy's solver."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from posture_opt.model.ldl import ldl, solved


@pytest.mark.parametrize("n", [1, 2, 6])
def test_a_positive_definite_system_is_solved(n: int) -> None:
    rng = np.random.default_rng(n)
    M = rng.normal(size=(n, n))
    A, b = M @ M.T + 0.1 * np.eye(n), rng.normal(size=n)
    x = np.asarray(ca.DM(solved(ldl(ca.SX(ca.DM(A))), ca.SX(ca.DM(b))))).ravel()
    # Rounding times the condition number, here below 1e4.
    np.testing.assert_allclose(x, np.linalg.solve(A, b), rtol=0, atol=1e-11 * np.linalg.norm(np.linalg.inv(A)))


def test_an_indefinite_matrix_shows_as_a_negative_pivot() -> None:
    _, pivots = ldl(ca.SX(ca.DM([[1.0, 2.0], [2.0, 1.0]])))
    assert [float(ca.DM(pivot)) for pivot in pivots] == [1.0, -3.0]


def test_the_unknown_of_a_row_that_repeats_another_is_zero() -> None:
    b = ca.SX(ca.DM([1.0, 1.0, 2.0]))
    A = ca.SX(ca.DM([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 4.0]]))
    x = np.asarray(ca.DM(solved(ldl(A, 1e-10), b))).ravel()
    np.testing.assert_allclose(x, [1.0, 0.0, 0.5], rtol=0, atol=1e-15)
