"""The probability that a tool point stays within its clearance at each of several places, errors that stay included.

Errors that stay are one draw δ for all places, scatter is a new draw ε at each. With the shifts of the tool point to
first order in δ, ``P = E_δ Π_k P(|b_k + A_k δ + ε_k| <= c_k)``. There are three cases: without errors that stay
it is the product, exactly; without scatter the radius of δ is integrated in closed form along random directions; else
the inner probabilities are integrated by quadrature and their product is averaged. Averages are randomised
quasi-Monte Carlo with a standard error from independent shifts of the points.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array
from posture_opt.uncertainty.moments.gaussian_rules import first_primes
from posture_opt.uncertainty.moments.pose_covariance import covariance_root
from posture_opt.uncertainty.regions.clearance import success_probability
from posture_opt.uncertainty.spread.spread import Spread
from posture_opt.uncertainty.spread.spread_parts import constant_covariance, positive_part, source_columns

_RANDOM_SHIFTS = 16
"""Independent shifts of the points: the standard error has 15 degrees of freedom."""
_DIRECTION_POINTS = 4096
"""Points of each shift, where the radius is integrated in closed form."""
_QUADRATURE_POINTS = 1024
"""Points of each shift, where the inner probabilities are integrated too."""
_INNER_QUADRATURE = (32, 7.0)
"""Nodes of the inner quadrature, and its half range in standard deviations: right to 1e-7."""
_THIN_SHARE = 1e-9
"""Share of the clearance below which a standard deviation of the scatter makes no difference."""
NO_SCATTER_SHARE = 1e-4
"""Share of the variance up to which there is no scatter, but higher orders of the errors that stay."""
IDLE_SHARE = 1e-9
"""Share of the largest singular value below which a direction of δ moves nothing."""


@dataclass(frozen=True)
class PlaceErrors:
    """The errors at one place in the m = 1 or 2 directions that count [m].

    Args:
        bias: (m,) mean.
        shared: (m, r) shift by independent standard normals that are one draw for all places.
        scatter: (m, m) covariance of what is a new draw here.
        clearance: radial.
    """

    bias: Array
    shared: Array
    scatter: Array
    clearance: float

    @classmethod
    def of(cls, spread: Spread, basis: Array, clearance: float) -> PlaceErrors:
        """The errors of the tool point at a posture; their covariance is the exact one.

        Args:
            spread: at that posture.
            basis: (3, m) orthonormal columns of the directions that count, world.
            clearance: radial [m].
        """
        names, J = source_columns(spread)
        C = basis.T @ spread.covariance @ basis
        constant = constant_covariance(spread, names)
        kept = np.flatnonzero(np.diag(constant) > 0)
        shared = basis.T @ J[:, kept] @ covariance_root(constant[np.ix_(kept, kept)])
        linear = shared @ shared.T
        scatter = positive_part(C - linear)
        if np.trace(scatter) <= NO_SCATTER_SHARE * np.trace(C) and np.trace(linear) > 0:
            scatter, shared = np.zeros_like(C), shared * math.sqrt(np.trace(C) / np.trace(linear))
        return cls(basis.T @ spread.bias, shared, scatter, clearance)

    @property
    def alone(self) -> float:
        """The probability of this place, whatever happens at the others."""
        return success_probability(self.shared @ self.shared.T + self.scatter, self.clearance, self.bias)


@dataclass(frozen=True)
class JointSuccess:
    """The probability that all succeed.

    Args:
        probability: that all stay within their clearance.
        standard_error: of it, by randomised integration; 0 in closed form.
        product: of the single probabilities, as if errors were independent.
    """

    probability: float
    standard_error: float
    product: float


def success_of_all(places: Sequence[PlaceErrors], seed: int = 0) -> JointSuccess:
    """The probability to stay within the clearance at every place.

    ``shared`` of all places has the same columns. The errors are small enough for the first order in them.
    """
    product = math.prod(place.alone for place in places)
    reduced = _reduced_places(places)
    rank = reduced[0].shared.shape[1]
    if len(places) == 1 or rank == 0:
        return JointSuccess(product, 0.0, product)
    rng = np.random.default_rng(seed)
    if any(np.any(place.scatter) for place in reduced):
        means = [
            1.0 - float(np.mean(_success_given_errors(reduced, _normal_points(u))))
            for u in _cube_points(rank, _QUADRATURE_POINTS, rng)
        ]
    elif rank == 1:
        return JointSuccess(
            1.0 - float(np.mean(_miss_given_direction(reduced, np.array([[1.0], [-1.0]])))), 0.0, product
        )
    else:
        means = [
            float(np.mean(_miss_given_direction(reduced, _unit_directions(u))))
            for u in _cube_points(rank, _DIRECTION_POINTS, rng)
        ]
    error = float(np.std(means, ddof=1)) / math.sqrt(_RANDOM_SHIFTS)
    return JointSuccess(1.0 - float(np.mean(means)), error, product)


def _reduced_places(places: Sequence[PlaceErrors]) -> list[PlaceErrors]:
    """The same places by the few combinations of δ that move anything, the one that moves most first."""
    A = np.vstack([place.shared / place.clearance for place in places])
    _, s, Vt = np.linalg.svd(A, full_matrices=False)
    kept = Vt[s > IDLE_SHARE * max(float(s[0]) if len(s) else 0.0, 1e-300)]
    return [PlaceErrors(p.bias, p.shared @ kept.T, p.scatter, p.clearance) for p in places]


def _cube_points(dimension: int, count: int, rng: np.random.Generator) -> list[Array]:
    """Some sets of points (count, dimension) inside the unit cube: multiples of irrational steps, shifted at random.

    Source: R. D. Richtmyer, Los Alamos report LA-1342 (1951); the steps are roots of primes.
    """
    steps = np.outer(np.arange(1, count + 1), np.sqrt(first_primes(dimension)))
    # Folded (the baker's transformation), which is smoother; inside of the cube, where quantiles are finite.
    sets = [np.abs(2 * ((steps + rng.random(dimension)) % 1.0) - 1) for _ in range(_RANDOM_SHIFTS)]
    return [np.clip(points, 1e-12, 1 - 1e-12) for points in sets]


def _normal_points(u: Array) -> Array:
    """Standard normal numbers from points in the cube."""
    from scipy.special import ndtri

    return np.asarray(ndtri(u))


def _unit_directions(u: Array) -> Array:
    """Unit vectors, evenly over the sphere, from points in the cube."""
    z = _normal_points(u)
    return np.asarray(z / np.linalg.norm(z, axis=1, keepdims=True))


def _miss_given_direction(places: Sequence[PlaceErrors], directions: Array) -> Array:
    """(N,) probability that any place is missed, given the direction of δ: its radius is chi distributed."""
    from scipy.special import gammainc, gammaincc

    near, far = np.zeros(len(directions)), np.full(len(directions), np.inf)
    for place in places:
        a = directions @ place.shared.T
        square, half = np.sum(a**2, axis=1), a @ place.bias
        power = place.clearance**2 - place.bias @ place.bias
        root = np.sqrt(np.maximum(half**2 + square * power, 0.0))
        inside = half**2 + square * power >= 0
        with np.errstate(divide="ignore", invalid="ignore"):
            # Of the two forms of a root take the one that does not subtract.
            last = np.where(half > 0, power / (half + root), (root - half) / square)
            first = np.where(half < 0, -power / (root - half), -np.inf)
        still = square == 0
        far = np.minimum(far, np.where(still, np.inf if power >= 0 else 0.0, np.where(inside, last, 0.0)))
        near = np.maximum(near, np.where(still | ~inside, 0.0, first))
    half_rank, far = directions.shape[1] / 2, np.maximum(far, near)
    return np.asarray(gammaincc(half_rank, far**2 / 2) + gammainc(half_rank, near**2 / 2))


def _success_given_errors(places: Sequence[PlaceErrors], delta: Array) -> Array:
    """(N,) probability that all succeed, given δ (N, r)."""
    p_success = np.ones(len(delta))
    for place in places:
        p_success *= within_circle(place.bias + delta @ place.shared.T, place.scatter, place.clearance)
    return p_success


def within_circle(
    mean: Array, covariance: Array, radius: float, quadrature: tuple[int, float] = _INNER_QUADRATURE
) -> Array:
    """(..., N) probability that Gaussian points with means (..., N, m), m = 1 or 2, lie in a circle about the origin.

    ``∫ φ(x) [Φ((h - μ)/σ) - Φ((-h - μ)/σ)] dx`` with ``h² = r² - x²`` along the minor axis, ``x = r sin θ``.

    Args:
        covariance: (..., m, m) of the points of each row; no axis of it counts as thinner than 1e-9 of the radius.
        quadrature: nodes, and the half range that they fill, in standard deviations.
    """
    if not np.any(covariance):
        return np.asarray(np.linalg.norm(mean, axis=-1) <= radius, dtype=float)
    values, axes = np.linalg.eigh(covariance)
    sigma, mu = np.sqrt(np.maximum(values, (_THIN_SHARE * radius) ** 2)), mean @ axes
    if mean.shape[-1] == 1:
        return _interval_probability(mu[..., 0], sigma, np.full(mu.shape[:-1], radius))
    thin, wide, along, across = sigma[..., :1], sigma[..., 1:], mu[..., 0], mu[..., 1]
    nodes, range_sigma = quadrature
    reach = range_sigma * thin
    low, high = (np.arcsin(np.clip((along + side * reach) / radius, -1.0, 1.0)) for side in (-1, 1))
    total = np.zeros(along.shape)
    for node, weight in zip(*_gauss_legendre(nodes), strict=True):
        theta = (low + high) / 2 + node * (high - low) / 2
        x, h = radius * np.sin(theta), radius * np.cos(theta)
        density = np.exp(-(((x - along) / thin) ** 2) / 2) / (math.sqrt(2 * math.pi) * thin)
        total += weight * (high - low) / 2 * h * density * _interval_probability(across, wide, h)
    return total


@functools.cache
def _gauss_legendre(count: int) -> tuple[list[float], list[float]]:
    """Nodes in (-1, 1) and weights."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes.tolist(), weights.tolist()


def _interval_probability(mu: Array, sigma: Array, h: Array) -> Array:
    """(..., N) probability that Gaussian numbers lie between -h and h."""
    from scipy.special import ndtr

    return np.asarray(ndtr((h - mu) / sigma) - ndtr((-h - mu) / sigma))
