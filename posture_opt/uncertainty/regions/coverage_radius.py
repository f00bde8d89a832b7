"""The distance from the target that holds a biased Gaussian point with a given probability."""

from __future__ import annotations

import functools
import math

import numpy as np

from posture_opt.numerics import Array
from posture_opt.uncertainty.regions.clearance import ball_probability, chi_tail, decreasing_root, radius_for
from posture_opt.uncertainty.regions.regions import coverage_factor


def coverage_radius(p: float, covariance: Array, bias: Array) -> float:
    """The radius r [m] with ``P(|x| ≤ r) = p ≥ 0.5`` for ``x ~ N(bias, covariance)`` (m,) [m], m = 1, 2 or 3."""
    return radius_for(p, covariance, bias) if len(covariance) < 3 else radius_in_space(p, covariance, bias)


def radius_in_space(p: float, covariance: Array, bias: Array) -> float:
    """The radius of `coverage_radius` in space: ten digits of a round ellipsoid, three of a line."""
    largest = math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))
    # All within k times the largest deviation of the mean lie in this ball, and that is p of them at the least.
    outer = float(np.linalg.norm(bias)) + coverage_factor(p, 3) * largest
    if not largest > 0:
        return outer
    return decreasing_root(lambda r: p - ball_probability(covariance, r, bias, (64, 128)), outer)


def central_radii(p: float, covariances: Array) -> Array:
    """The radii (N,) [m] about their means that hold Gaussian points, covariances (N, m, m) [m²], with probability p.

    In the principal axes ``P(|x| > r)`` is the mean, over the directions u of the first quadrant or octant, of the chi
    distribution's tail at ``r / √(Σ s_i² u_i²)``, and r is found by bisection.
    """
    from scipy.special import erfc

    variances = np.linalg.eigvalsh(covariances).clip(0)
    m = variances.shape[1]
    squares, weights = _octant_rule(m)
    reach = np.sqrt(variances @ squares.T)
    scatters = reach > 0
    per_length = 1 / np.where(scatters, reach, 1.0)
    low, high = np.zeros(len(variances)), coverage_factor(p, m) * np.sqrt(variances[:, -1])
    for _ in range(45):  # which leave 3e-14 of the first interval
        middle = (low + high) / 2
        z = np.where(scatters, middle[:, None] * per_length, np.inf)
        outside = chi_tail(z, m, erfc) @ weights > 1 - p
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    return np.asarray((low + high) / 2)


@functools.cache
def _octant_rule(m: int) -> tuple[Array, Array]:
    """Squared components (K, m) of directions in the first octant (quadrant, half line), and their weights (K,)."""
    if m == 1:
        return np.ones((1, 1)), np.ones(1)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    t, w = (nodes + 1) / 2, weights / 2
    turn = np.pi / 2 * t
    if m == 2:
        return np.column_stack([np.cos(turn) ** 2, np.sin(turn) ** 2]), w
    rise, along = np.meshgrid(t**2, turn, indexing="ij")
    flat = 1 - rise
    squares = np.stack([flat * np.cos(along) ** 2, flat * np.sin(along) ** 2, rise], axis=-1)
    return squares.reshape(-1, 3), np.outer(w, w).ravel()
