"""The probability that a tool point stays within its clearance at each of several places, errors that stay included.

Errors that stay are one draw δ for all places, scatter is a new draw ε at each. With the shifts of the tool point to
first order in δ, ``P = E_δ Π_k P(|b_k + A_k δ + ε_k| <= c_k)``. There are three cases: without errors that stay
it is the product, exactly; without scatter the radius of δ is integrated in closed form along random directions; else
the inner probabilities are integrated by quadrature and their product is averaged. Averages are randomised
quasi-Monte Carlo with a standard error from independent shifts of the points. With the draws of δ fixed, every posture
has one vector of probabilities: combinations of postures are compared by the mean of the product of theirs.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from posture_opt.numerics import Array
from posture_opt.uncertainty.clearance import ray_crossings, success_probability
from posture_opt.uncertainty.gaussian_rules import first_primes
from posture_opt.uncertainty.pose_covariance import covariance_root
from posture_opt.uncertainty.spread import Spread
from posture_opt.uncertainty.spread_parts import constant_covariance, positive_part


class ErrorParts(NamedTuple):
    """The errors at P postures in the m = 1 or 2 directions that count, over the clearance or in m."""

    bias: Array  # (P, m) mean
    shared: Array  # (P, m, r) shift by independent standard normals that are one draw for all places
    scatter: Array  # (P, m, m) covariance of what is a new draw at each

    @classmethod
    def of(cls, bias: Array, shared: Array, covariance: Array) -> ErrorParts:
        """From the whole covariance (P, m, m): what ``shared`` leaves of it is scatter, unless it is below 1e-4."""
        linear = shared @ np.swapaxes(shared, 1, 2)
        scatter = positive_part(covariance - linear)
        whole, stays, rest = (np.trace(part, axis1=1, axis2=2) for part in (covariance, linear, scatter))
        still = ((rest <= 1e-4 * whole) & (stays > 0))[:, None, None]
        factor = np.sqrt(whole / np.where(stays > 0, stays, 1.0))[:, None, None]
        return cls(bias, np.where(still, shared * factor, shared), np.where(still, 0.0, scatter))


@dataclass(frozen=True)
class PlaceErrors:
    """The errors at one place in the m = 1 or 2 directions that count [m], see `ErrorParts`."""

    bias: Array  # (m,)
    shared: Array  # (m, r)
    scatter: Array  # (m, m)
    clearance: float  # radial

    @classmethod
    def of(cls, spread: Spread, basis: Array, clearance: float) -> PlaceErrors:
        """At the posture of a spread, along orthonormal columns (3, m), world; the covariance is the exact one."""
        point = spread.tool_point
        constant = constant_covariance(spread, point.every_source[0])
        kept = np.flatnonzero(np.diag(constant) > 0)
        columns = point.every_column(spread.q)[:, kept]
        shared = basis.T @ columns @ covariance_root(constant[np.ix_(kept, kept)])
        C = basis.T @ spread.covariance @ basis
        found = ErrorParts.of((basis.T @ spread.bias)[None], shared[None], C[None])
        return cls(found.bias[0], found.shared[0], found.scatter[0], clearance)

    @property
    def alone(self) -> float:
        """The probability of this place, whatever happens at the others."""
        return success_probability(self.shared @ self.shared.T + self.scatter, self.clearance, self.bias)


@dataclass(frozen=True)
class JointSuccess:
    """The probability that all stay within their clearance."""

    probability: float
    standard_error: float  # by randomised integration; 0 in closed form
    product: float  # of the single probabilities, as if errors were independent


def success_of_all(places: Sequence[PlaceErrors], seed: int = 0) -> JointSuccess:
    """The probability to stay within the clearance at every place; ``shared`` of all places has the same columns."""
    product = math.prod(place.alone for place in places)
    kept = _leading_directions(np.vstack([place.shared / place.clearance for place in places]))
    reduced = [PlaceErrors(p.bias, p.shared @ kept.T, p.scatter, p.clearance) for p in places]
    rank, rng = len(kept), np.random.default_rng(seed)
    if len(places) == 1 or rank == 0:
        return JointSuccess(product, 0.0, product)
    if any(np.any(place.scatter) for place in reduced):
        means = [1.0 - float(np.mean(_success_given_errors(reduced, z))) for z in _normal_sets(rank, 1024, rng)]
    elif rank == 1:
        missed = float(np.mean(_miss_given_direction(reduced, np.array([[1.0], [-1.0]]))))
        return JointSuccess(1.0 - missed, 0.0, product)
    else:
        means = [
            float(np.mean(_miss_given_direction(reduced, z / np.linalg.norm(z, axis=1, keepdims=True))))
            for z in _normal_sets(rank, 4096, rng)
        ]
    error = float(np.std(means, ddof=1)) / math.sqrt(len(means))
    return JointSuccess(1.0 - float(np.mean(means)), error, product)


def _leading_directions(shared: Array) -> Array:
    """(k, r) orthonormal combinations of δ that move anything by ``shared`` (N, r), the one that moves most first."""
    _, s, Vt = np.linalg.svd(shared, full_matrices=False)
    kept: Array = Vt[s > 1e-9 * max(float(s[0]) if len(s) else 0.0, 1e-300)]
    return kept


def _irrational_steps(dimension: int, count: int) -> Array:
    """(count, dimension) multiples of roots of primes (R. D. Richtmyer, Los Alamos report LA-1342, 1951)."""
    steps: Array = np.outer(np.arange(1.0, count + 1), np.sqrt(first_primes(dimension)))
    return steps


def _normal_points(u: Array) -> Array:
    from scipy.special import ndtri

    return np.asarray(ndtri(np.clip(u, 1e-12, 1 - 1e-12)))


def _normal_sets(dimension: int, count: int, rng: np.random.Generator, shifts: int = 16) -> list[Array]:
    """Sets of standard normal points (count, dimension), each of steps with a random shift of its own."""
    steps = _irrational_steps(dimension, count)
    # Folded (the baker's transformation), which is smoother.
    return [_normal_points(np.abs(2 * ((steps + rng.random(dimension)) % 1.0) - 1)) for _ in range(shifts)]


def _miss_given_direction(places: Sequence[PlaceErrors], directions: Array) -> Array:
    """(N,) probability that any place is missed, given the direction of δ: its radius is chi distributed."""
    from scipy.special import gammainc, gammaincc

    near, far = np.zeros(len(directions)), np.full(len(directions), np.inf)
    for place in places:
        first, last = ray_crossings(place.bias, directions @ place.shared.T, place.clearance)
        near, far = np.maximum(near, first), np.minimum(far, last)
    half_rank, far = directions.shape[1] / 2, np.maximum(far, near)
    return np.asarray(gammaincc(half_rank, far**2 / 2) + gammainc(half_rank, near**2 / 2))


def _success_given_errors(places: Sequence[PlaceErrors], delta: Array) -> Array:
    """(N,) probability that all succeed, given δ (N, r)."""
    p_success = np.ones(len(delta))
    for place in places:
        p_success *= _within_circle(place.bias + delta @ place.shared.T, place.scatter, place.clearance)
    return p_success


def _within_circle(mean: Array, covariance: Array, radius: float, quadrature: tuple[int, float] = (32, 7.0)) -> Array:
    """(..., N) probability that points of means (..., N, m), m = 1 or 2, covariances (..., m, m), lie in a circle about
    the origin: ``∫ φ(x) [Φ((h - μ)/σ) - Φ((-h - μ)/σ)] dx``, ``h² = r² - x²`` along the minor axis, ``x = r sin θ``.
    ``quadrature``: nodes and their half range in σ; 32 over 7 are right to 1e-7."""
    if not np.any(covariance):
        return np.asarray(np.linalg.norm(mean, axis=-1) <= radius, dtype=float)
    values, axes = np.linalg.eigh(covariance)
    sigma, mu = np.sqrt(np.maximum(values, (1e-9 * radius) ** 2)), mean @ axes  # a thinner axis makes no difference
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
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes.tolist(), weights.tolist()


def _interval_probability(mu: Array, sigma: Array, h: Array) -> Array:
    """(..., N) probability that Gaussian numbers lie between -h and h."""
    from scipy.special import ndtr

    return np.asarray(ndtr((h - mu) / sigma) - ndtr((-h - mu) / sigma))


@dataclass(frozen=True)
class SharedDraws:
    """Draws δ (N, r) of the errors that stay, standard normal."""

    delta: Array

    @classmethod
    def of(cls, shared: Sequence[Array], count: int) -> SharedDraws:
        """``count`` draws in the combinations of δ that move postures by ``shared`` (P, m, r), half mirrored."""
        leading = _leading_directions(np.concatenate([A.reshape(-1, A.shape[-1]) for A in shared]))
        z = _normal_points((_irrational_steps(len(leading), count // 2) + 0.5) % 1.0)
        return cls(np.vstack([z, -z]) @ leading)

    def success(self, errors: ErrorParts) -> Array:
        """(P, N) the probability of each posture given each draw, to 0.003; 512 rows at once bound the memory."""
        found = [np.zeros((0, len(self.delta)))]
        for first in range(0, len(errors.bias), 512):
            bias, shared, scatter = (part[first : first + 512] for part in errors)
            mean = bias[:, None] + self.delta @ np.swapaxes(shared, 1, 2)
            found.append(_within_circle(mean, scatter, 1.0, (12, 4.0)))
        return np.vstack(found)
