"""Least squares without negative values against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from posture_opt.validation.nonnegative import nonnegative_least_squares


@pytest.mark.parametrize("shape", [(1, 1), (3, 3), (9, 9), (12, 5)])
def test_the_least_squares_are_those_of_scipy(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(sum(shape))
    for _ in range(40):
        A, b = rng.normal(size=shape) + rng.choice([0.0, 1.0]), rng.normal(size=shape[0])
        np.testing.assert_allclose(nonnegative_least_squares(A, b), nnls(A, b)[0], rtol=1e-9, atol=1e-11)
