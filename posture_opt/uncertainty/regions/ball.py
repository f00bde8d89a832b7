"""The probability that a biased Gaussian point in space stays within a ball: a clearance to every side."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from posture_opt.numerics import Array

_HEIGHTS, _TURNS = 96, 64  # nodes on the sphere: seven digits for clearances of up to 20 σ


def ball_probability(covariance: Array, radius: float, bias: Array) -> float:
    """``P(|x| ≤ r)`` of ``x ~ N(b, C)`` in space.

    Along a direction u of the sphere ``x = b + ρ L u``, L Lᵀ = C, is in the ball between its crossings ``ρ₁ < ρ₂``; the
    distance ρ of a standard normal point is beyond ρ₁ with the probability ``S(ρ) = erfc(ρ/√2) + √(2/π) ρ exp(−ρ²/2)``.
    The mean of ``S(ρ₁) − S(ρ₂)`` over the sphere is taken by Gauss's rule in height about the longest axis, and the
    trapezoid rule about it.

    Args:
        covariance: (3, 3) [m²], positive semidefinite; zero is allowed.
        radius: r > 0 [m].
        bias: (3,) [m].
    """
    variances, axes = np.linalg.eigh(np.asarray(covariance, dtype=float))
    sigma, b = np.sqrt(variances.clip(0.0)), axes.T @ np.asarray(bias, dtype=float)
    gap = radius**2 - float(b @ b)
    if not sigma[-1] > 0:
        return float(gap >= 0)
    u, weights = _sphere()
    d = u * sigma
    alpha, beta = np.square(d).sum(axis=1), d @ b
    root = np.sqrt((beta**2 + alpha * gap).clip(0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(beta <= 0, (root - beta) / alpha, gap / (root + beta))
        near = np.where((gap < 0) & (beta < 0), -gap / (root - beta), 0.0)
    missed = (gap < 0) & ((beta >= 0) | (beta**2 + alpha * gap <= 0))
    inside = np.where(missed, 0.0, _beyond(near) - _beyond(far))
    return float(np.clip(weights @ inside, 0.0, 1.0))


def _beyond(rho: Array) -> Array:
    """(N,) the probability that a standard normal point in space is farther than ρ from the origin."""
    finite = np.minimum(rho, 40.0)
    tail = np.fromiter(map(math.erfc, finite / math.sqrt(2)), dtype=float, count=len(finite))
    return np.asarray(tail + math.sqrt(2 / math.pi) * finite * np.exp(-(finite**2) / 2))


@cache
def _sphere() -> tuple[Array, Array]:
    """Directions (N, 3) and their weights (N,), the sum of which is 1."""
    height, share = np.polynomial.legendre.leggauss(_HEIGHTS)
    turn = 2 * math.pi * np.arange(_TURNS) / _TURNS
    z, angle = (part.ravel() for part in np.meshgrid(height, turn, indexing="ij"))
    across = np.sqrt(1 - z**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), z]), np.repeat(share / 2 / _TURNS, _TURNS)
