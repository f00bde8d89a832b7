"""The distance from the target that holds a biased Gaussian point with a given probability.

In three dimensions the direction is integrated over the sphere: with ``x = b + ρ L u`` and ``|b + ρ L u| = r`` at
``ρ*(u)``, ``P(|x| > r)`` is the mean over all directions u of the tail of the chi distribution with three degrees of
freedom, ``erfc(ρ*/√2) + √(2/π) ρ* e^{−ρ*²/2}`` (M. Abramowitz and I. A. Stegun, Handbook of Mathematical Functions
(1964), 26.4.4). In the plane and on a line: :mod:`posture_opt.uncertainty.regions.clearance`.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from posture_opt.numerics import TURN, Array
from posture_opt.uncertainty.regions.clearance import decreasing_root, radius_for
from posture_opt.uncertainty.regions.regions import coverage_factor

_POLAR_NODES, _AZIMUTHS = 64, 128
"""Directions on the sphere: ten digits of a round ellipsoid, three of a line in space."""
_OCTANT_NODES, _HALVINGS = 24, 45
"""Directions along an octant's sides, and bisections: these leave 3e-14 of the first interval."""
_erfc = np.vectorize(math.erfc, otypes=[float])


def coverage_radius(p: float, covariance: Array, bias: Array) -> float:
    """The radius r [m] with ``P(|x| ≤ r) = p`` for ``x ~ N(bias, covariance)`` on a line, in the plane or in space.

    Args:
        p: probability, at least 0.5.
        covariance: (m, m) [m²], m = 1, 2 or 3, positive semidefinite.
        bias: (m,) [m].

    Example:
        >>> print(f"{coverage_radius(0.95, np.eye(3), np.zeros(3)):.4f}")
        2.7955
    """
    return radius_for(p, covariance, bias) if len(covariance) < 3 else radius_in_space(p, covariance, bias)


def radius_in_space(p: float, covariance: Array, bias: Array) -> float:
    """The radius r [m] with ``P(|x| ≤ r) = p`` for ``x ~ N(bias, covariance)`` in space.

    Args:
        p: probability, at least 0.5.
        covariance: (3, 3) [m²], positive semidefinite.
        bias: (3,) [m].
    """
    values, vectors = np.linalg.eigh(covariance)
    L = vectors * np.sqrt(values.clip(0))
    # All within k times the largest deviation of the mean lie in this ball, and that is p of them at the least.
    outer = float(np.linalg.norm(bias)) + coverage_factor(p, 3) * math.sqrt(max(float(values[-1]), 0.0))
    return decreasing_root(lambda r: _miss_in_space(L, bias, r) - (1 - p), outer) if values[-1] > 0 else outer


def _miss_in_space(L: Array, b: Array, r: float) -> float:
    """``P(|b + L z| > r)`` for ``|b| ≤ r``; one for a smaller r, which holds less than half of the points."""
    directions, weights = _sphere_rule()
    d = directions @ L.T
    alpha, beta = np.sum(d * d, axis=1), d @ b
    gap = max(r * r - float(b @ b), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # The positive root in the form that does not cancel; a direction without scatter never leaves the ball.
        rho = np.where(alpha > 0, gap / (beta + np.sqrt(beta * beta + alpha * gap)), np.inf)
    rho = np.where(np.isnan(rho), 0.0, rho).clip(0, 40)
    tail = _erfc(rho / math.sqrt(2)) + math.sqrt(2 / math.pi) * rho * np.exp(-rho * rho / 2)
    return float(weights @ tail)


@functools.cache
def _sphere_rule() -> tuple[Array, Array]:
    """Directions (k, 3) and weights (k,) of a product rule on the sphere; the weights add up to one."""
    z, w = np.polynomial.legendre.leggauss(_POLAR_NODES)
    phi = TURN * np.arange(_AZIMUTHS) / _AZIMUTHS
    s = np.sqrt(1 - z * z)
    directions = np.stack(
        [np.outer(s, np.cos(phi)), np.outer(s, np.sin(phi)), np.outer(z, np.ones(_AZIMUTHS))], axis=-1
    )
    return directions.reshape(-1, 3), np.repeat(w / (2 * _AZIMUTHS), _AZIMUTHS)


def central_radii(p: float, covariances: Array) -> Array:
    """The radii (N,) [m] about their means that hold N Gaussian points with probability p, all at once.

    In the principal axes ``P(|x| > r)`` is the mean, over the directions u of the first quadrant or octant, of the
    chi distribution's tail at ``r / √(Σ s_i² u_i²)``, and r is found by bisection.

    Args:
        covariances: (N, m, m) [m²], m = 1, 2 or 3; zero is allowed.
    """
    variances = np.linalg.eigvalsh(covariances).clip(0)
    m = variances.shape[1]
    squares, weights = _octant_rule(m)
    reach = np.sqrt(variances @ squares.T)
    scatters = reach > 0
    per_length = 1 / np.where(scatters, reach, 1.0)
    low, high = np.zeros(len(variances)), coverage_factor(p, m) * np.sqrt(variances[:, -1])
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        z = np.where(scatters, middle[:, None] * per_length, np.inf)
        outside = _chi_tail(z, m) @ weights > 1 - p
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    return np.asarray((low + high) / 2)


@functools.cache
def _octant_rule(m: int) -> tuple[Array, Array]:
    """Squared components (K, m) of directions in the first octant (quadrant, half line), and their weights (K,)."""
    if m == 1:
        return np.ones((1, 1)), np.ones(1)
    nodes, weights = np.polynomial.legendre.leggauss(_OCTANT_NODES)
    t, w = (nodes + 1) / 2, weights / 2
    turn = np.pi / 2 * t
    if m == 2:
        return np.column_stack([np.cos(turn) ** 2, np.sin(turn) ** 2]), w
    rise, along = np.meshgrid(t**2, turn, indexing="ij")
    flat = 1 - rise
    squares = np.stack([flat * np.cos(along) ** 2, flat * np.sin(along) ** 2, rise], axis=-1)
    return squares.reshape(-1, 3), np.outer(w, w).ravel()


def _chi_tail(z: Array, m: int) -> Array:
    """P(chi > z) for m degrees of freedom, infinity allowed."""
    if m == 2:
        return np.asarray(np.exp(-(z**2) / 2))
    from scipy.special import erfc

    tail = erfc(z / math.sqrt(2))
    if m == 3:
        tail = tail + math.sqrt(2 / math.pi) * np.where(np.isinf(z), 0.0, z) * np.exp(-(z**2) / 2)
    return np.asarray(tail)
