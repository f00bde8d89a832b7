"""Rows linked by small steps against SciPy's tree and components."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from posture_opt.measurements.repeats import linked_rows

RNG = np.random.default_rng(3)
POINTS = {
    "spread": (RNG.uniform(-3, 3, (2000, 6)), 1e-3),
    "repeats": (np.repeat(RNG.uniform(-3, 3, (60, 6)), 10, axis=0) + RNG.normal(0, 3e-4, (600, 6)), 1e-3),
    "grid": (np.stack(np.meshgrid(*[np.linspace(-1, 1, 5)] * 4), axis=-1).reshape(-1, 4), 0.5),
    "chain": (RNG.uniform(0, 1, (1000, 1)), 1e-3),
    "one": (np.zeros((1, 3)), 1.0),
    "none": (np.zeros((0, 2)), 1.0),
}


@pytest.mark.parametrize("name", POINTS)
def test_linked_rows_are_the_components_of_near_pairs(name: str) -> None:
    points, reach = POINTS[name]
    pairs = (
        cKDTree(points).query_pairs(reach, p=np.inf, output_type="ndarray") if len(points) else np.zeros((0, 2), int)
    )
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    expected = connected_components(links, directed=False)[1] if len(points) else np.zeros(0, int)
    np.testing.assert_array_equal(linked_rows(points, reach), expected)
