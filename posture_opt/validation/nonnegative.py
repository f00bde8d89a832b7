"""Least squares without negative values, for the few variances of a model."""

from __future__ import annotations

import numpy as np

from posture_opt.numerics import Array

_TOLERANCE = 1e-13  # of the largest slope at zero: a smaller one is rounding


def nonnegative_least_squares(A: Array, b: Array) -> Array:
    """The x (k,) ≥ 0 with the least ``|A x − b|``, A (m, k): an active set (Lawson, Hanson 1974, chapter 23).

    SciPy has the same; for a handful of numbers its import takes longer than all of them.

    Example:
        >>> nonnegative_least_squares(np.eye(2), np.array([1.0, -2.0])).tolist()
        [1.0, 0.0]
    """
    x, held = np.zeros(A.shape[1]), np.ones(A.shape[1], dtype=bool)
    least = _TOLERANCE * float(np.abs(A.T @ b).max(initial=0.0))
    for _ in range(3 * A.shape[1]):
        slope = np.where(held, A.T @ (b - A @ x), -np.inf)
        if slope.max(initial=-np.inf) <= least:
            break
        held[np.argmax(slope)] = False
        while True:
            wanted = np.zeros(len(x))
            wanted[~held] = np.linalg.lstsq(A[:, ~held], b, rcond=None)[0]
            below = ~held & (wanted <= 0)
            if not below.any():
                break
            # As far towards it as all stay above zero; those that reach it are held there.
            x += np.min(x[below] / (x[below] - wanted[below])) * (wanted - x)
            held |= x <= _TOLERANCE * np.abs(x).max()
            x[held] = 0.0
        x = wanted
    return x
