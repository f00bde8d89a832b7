"""How far figures of a sample may lie from the true ones: 95 % intervals of sampling alone."""

from __future__ import annotations

import math

import numpy as np

from posture_opt.numerics import Array
from posture_opt.uncertainty.regions.regions import NORMAL95
from posture_opt.uncertainty.simulation.sampler import PAIRS

Interval = tuple[float, float]


def variance_intervals(axes: Array, values: Array, covariance_of_covariance: Array) -> Array:
    """(m, 2) 95 % sampling intervals of the variances (m,) [m²] along unit vectors (m, 3), one a row.

    To first order a variance moves by ``vᵀ dC v``. The interval is symmetric in its logarithm, which keeps it positive.

    Args:
        covariance_of_covariance: (6, 6) of the entries xx, xy, xz, yy, yz, zz of the sample covariance [m⁴].
    """
    weights = np.array([[(2 - (i == j)) * v[i] * v[j] for i, j in PAIRS] for v in axes])
    variance = np.einsum("ma,ab,mb->m", weights, covariance_of_covariance, weights)
    relative = np.sqrt(np.clip(variance, 0, None)) / np.where(values > 0, values, 1.0)
    return np.stack([values * np.exp(-NORMAL95 * relative), values * np.exp(NORMAL95 * relative)], axis=-1)


def wilson_interval(inside: int, n: int) -> Interval:
    """The 95 % score interval of a probability of which ``inside`` of n trials came true.

    Source: E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
    """
    p, z2 = inside / n, NORMAL95**2 / n
    centre, half = p + z2 / 2, math.sqrt(z2 * (p * (1 - p) + z2 / 4))
    return max(0.0, (centre - half) / (1 + z2)), min(1.0, (centre + half) / (1 + z2))


def symmetric_matrix(entries: Array) -> Array:
    """(3, 3) symmetric matrix of its entries (6,) xx, xy, xz, yy, yz, zz."""
    full = np.zeros((3, 3))
    for value, (i, j) in zip(entries, PAIRS, strict=True):
        full[i, j] = full[j, i] = value
    return full
