"""Rows that small steps lead from one to another, without a tree: SciPy's would take longer to import than to use."""

from __future__ import annotations

import numpy as np

from posture_opt.numerics import Array, Codes


def linked_rows(points: Array, reach: float) -> Codes:
    """Codes (N,) of rows (N, d) that steps of at most ``reach`` in every coordinate lead from one to the other.

    Example:
        >>> linked_rows(np.array([[0.0], [5.0], [0.9], [1.8]]), 1.0).tolist()
        [0, 1, 0, 0]
    """
    first, second = _near_pairs(points, reach)
    label = np.arange(len(points))
    while np.any(label[first] != label[second]):
        least = np.minimum(label[first], label[second])
        for ends in (first, second):
            np.minimum.at(label, label[ends], least)
        label = label[label]
    return np.asarray(np.unique(label, return_inverse=True)[1], dtype=np.intp)


def _near_pairs(points: Array, reach: float) -> tuple[Codes, Codes]:
    """Pairs of rows (N, d) within ``reach`` of each other in every coordinate: each row with those behind it in order.

    The order is that along a direction in which no grid has equal steps: what is near is near there too.
    """
    along = np.sqrt(np.arange(points.shape[1]) + 2.0) % 1 + 0.5
    height = points @ along
    order = np.argsort(height, kind="stable")
    height, points = height[order], points[order]
    window = reach * float(along.sum()) * (1 + 1e-9) + 1e-9 * float(np.abs(height).max(initial=0.0))
    found = [np.zeros((2, 0), dtype=np.intp)]
    for behind in range(1, len(points)):
        i = np.flatnonzero(height[behind:] - height[:-behind] <= window)
        if not len(i):
            break
        i = i[np.max(np.abs(points[i + behind] - points[i]), axis=1) <= reach]
        found.append(order[np.stack([i, i + behind])])
    first, second = np.concatenate(found, axis=1)
    return first, second
