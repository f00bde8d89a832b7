"""The search between two ends against SciPy's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from posture_opt.diagnosis.search.bounded_search import bounded_minimum

FUNCTIONS: dict[str, Callable[[float], float]] = {
    "valley": lambda x: (x - 1.3) ** 2 + 0.01 * x**4,
    "flat": lambda x: 0.0,
    "edge": lambda x: -x,
    "other edge": lambda x: x,
    "wave": lambda x: float(np.sin(3 * x) + 0.1 * x),
    "kink": lambda x: abs(x - 0.7) ** 0.5,
}


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("evaluations", [2, 6, 16, 60])
@pytest.mark.parametrize("ends", [(0.0, 3.0), (-2.0, 5.5), (0.6, 0.8)])
def test_a_bounded_search_looks_where_scipy_does(name: str, evaluations: int, ends: tuple[float, float]) -> None:
    seen: list[float] = []

    def f(x: float) -> float:
        seen.append(x)
        return FUNCTIONS[name](x)

    x, value = bounded_minimum(f, *ends, evaluations)
    own, seen = seen, []
    found = minimize_scalar(f, bounds=ends, method="bounded", options={"maxiter": evaluations})
    np.testing.assert_allclose(own, seen[: len(own)], rtol=1e-9)
    assert len(own) == found.nfev
    assert (x, value) == (pytest.approx(found.x, rel=1e-9), pytest.approx(found.fun, rel=1e-9))
