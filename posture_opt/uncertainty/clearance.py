"""The probability that a biased Gaussian point stays within a radial clearance, and the radius of a probability.

``|x|^2`` of ``x ~ N(b, C)`` is a quadratic form of normals. Its distribution is computed, not sampled: a peg that
misses once in 10^30 gets that number, and an optimiser gets a smooth one.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from posture_opt.encoding import Encoded
from posture_opt.errors import InputError, SolverError
from posture_opt.numerics import TURN, Array
from posture_opt.uncertainty.regions import RANK_TOLERANCE, coverage_factor, deviation


def miss_probability(covariance: ArrayLike, clearance: float, bias: ArrayLike | None = None) -> float:
    """The probability that a Gaussian point, C (m, m) [m²], m = 1 or 2, mean b (m,) [m], is beyond the clearance.

    ``P = 1/(2 pi) Int exp(-rho(phi)^2 / 2) dphi`` with ``|b + rho L u(phi)| = r``, ``L L' = C``,
    ``u = (cos phi, sin phi)``: the radius of a standard normal point exceeds rho with probability ``exp(-rho^2 / 2)``.
    On a line (m = 1, or C of rank one) this is ``Phi((b - r) / s) + Phi((-b - r) / s)`` by J. W. Craig's form of the
    normal tail. Sources: J. W. Craig, IEEE MILCOM (1991) 571; H. Takahasi and M. Mori, Publ. RIMS 9 (1974) 721.
    """
    return math.exp(log_miss_probability(covariance, clearance, bias))


def success_probability(covariance: ArrayLike, clearance: float, bias: ArrayLike | None = None) -> float:
    """``1 - miss_probability``."""
    return -math.expm1(log_miss_probability(covariance, clearance, bias))


def within_clearance(covariance: Array, clearance: float, bias: Array) -> float | None:
    """The probability that a point (m,), m = 1, 2 or 3, is within the clearance [m]; None without one (NaN)."""
    if math.isnan(clearance):
        return None
    return (ball_probability if len(covariance) > 2 else success_probability)(covariance, clearance, bias)


def log_miss_probability(covariance: ArrayLike, clearance: float, bias: ArrayLike | None = None) -> float:
    """The natural logarithm of `miss_probability`; it goes on where the probability itself is below 1e-308."""
    sigma, b = _principal_axes(covariance, bias)
    if not clearance >= 0:
        raise InputError(f"a clearance is a length of zero or more, not {clearance:g}")
    return _log_miss(sigma, b, clearance)


def radius_for(p: float, covariance: ArrayLike, bias: ArrayLike | None = None) -> float:
    """The radius r [m] about the origin with ``miss_probability(C, r, b) = 1 - p``."""
    if not 0 < p < 1:
        raise InputError(f"a coverage probability lies between 0 and 1, not at {p:g}")
    sigma, b = _principal_axes(covariance, bias)
    goal = math.log1p(-p)
    # All within k times the largest deviation of the mean lie in this circle, and that is p of them at the least.
    outer = float(math.hypot(*b) + sigma[0] * math.sqrt(-2 * goal))
    if not sigma[0] > 0:
        return outer
    # A tail of one dimension is no longer than that of two, and a mean off the middle makes it no shorter. In r² the
    # logarithm is nearly a straight line, so that regula falsi takes few steps.
    inner = float((1 - 1e-9) * sigma[0] * coverage_factor(p, 1))  # less what rounding may put on the other side
    square = decreasing_root(lambda s: _log_miss(sigma, b, math.sqrt(s)) - goal, outer**2, inner**2, enough=1e-13)
    return math.sqrt(square)


def _principal_axes(covariance: ArrayLike, bias: ArrayLike | None) -> tuple[Array, Array]:
    """Standard deviations (2,) [m], descending, and mean (2,) [m] in the principal axes; a line gets a zero axis."""
    C = np.atleast_2d(np.asarray(covariance, dtype=float))
    m = len(C)
    b = np.zeros(m) if bias is None else np.atleast_1d(np.asarray(bias, dtype=float))
    if m > 2 or C.shape != (m, m) or b.shape != (m,):
        raise InputError(f"a radial clearance takes a (2, 2) covariance and a (2,) bias, not {C.shape} and {b.shape}")
    if not (np.isfinite(C).all() and np.isfinite(b).all()):
        raise InputError("covariance and bias have to be finite")
    variances, axes = np.linalg.eigh((C + C.T) / 2)
    sigma = np.sqrt(np.clip(variances, 0, None))[::-1]
    rotated = (axes.T @ b)[::-1]
    return (sigma, rotated) if m == 2 else (np.append(sigma, 0.0), np.append(rotated, 0.0))


def _log_miss(sigma: Array, b: Array, r: float) -> float:
    """Logarithm of the probability of a miss, of ``sigma`` (2,) and mean ``b`` (2,) in the principal axes [m]."""
    distance = math.hypot(*b)
    if sigma[0] == 0 or math.isinf(r):
        return 0.0 if distance > r else -math.inf
    return _log_miss_from_inside(sigma, b, r) if distance <= r else math.log1p(-_hit_from_outside(sigma, b, r))


def _log_miss_from_inside(sigma: Array, b: Array, r: float) -> float:
    """The mean lies in the circle: every ray from it leaves the circle once, at rho(phi)."""
    distance = math.hypot(*b)
    power = (r - distance) * (r + distance)

    def half_squared_radius(phi: Array) -> Array:
        step = sigma[:, None, None] * np.array([np.cos(phi), np.sin(phi)])
        A, B = (step**2).sum(axis=0), np.tensordot(b, step, 1)
        root = np.sqrt(B**2 + A * power)
        # Of the two forms of the root take the one that does not subtract.
        rho = np.where(B > 0, power / (B + root), (root - B) / A)
        distances: Array = np.where(A > 0, rho**2 / 2, math.inf)
        return distances

    # The integrand is sharp, at worst, near the axes of the ellipse and where a ray starts at right angles to b.
    tangent = math.atan2(-b[0] * sigma[0], b[1] * sigma[1])
    quarters = np.arange(5) * math.pi / 2
    breaks = _ascending_points(quarters, np.mod([tangent, tangent + math.pi], 2 * math.pi))
    return _log_integral(half_squared_radius, breaks) - math.log(2 * math.pi)


def _hit_from_outside(sigma: Array, b: Array, r: float) -> float:
    """The mean lies outside: the rays of one cone, psi from its axis, enter the circle at rho_1 and leave at rho_2."""
    distance = math.hypot(*b)
    power = (distance - r) * (distance + r)
    axis, spread, half = _hit_cone(sigma, b, r, power)
    if half == 0:
        return 0.0

    def minus_log_hit(psi: Array) -> Array:
        u = np.multiply.outer(axis, np.cos(psi)) + np.multiply.outer([-axis[1], axis[0]], np.sin(psi))
        step = sigma[:, None, None] * u
        A, B = (step**2).sum(axis=0), -np.tensordot(b, step, 1)
        # B^2 - A power, but zero where the cone ends and nowhere else.
        root = np.sqrt(spread * np.clip(np.sin(half - psi) * np.sin(half + psi), 0, None))
        between = 2 * root * B / A**2  # (rho_2^2 - rho_1^2) / 2
        result: Array = (power / (B + root)) ** 2 / 2 - np.log(-np.expm1(-between))
        return result

    quarters = np.arange(-4, 5) * math.pi / 2 - math.atan2(axis[1], axis[0])
    breaks = _ascending_points(quarters[np.abs(quarters) < half], np.array([-half, 0.0, half]))
    # A miss is at least as likely as a hit here, so that a hit need be known in absolute terms only.
    return min(math.exp(_log_integral(minus_log_hit, breaks, negligible=1e-14) - math.log(2 * math.pi)), 1.0)


def _hit_cone(sigma: Array, b: Array, r: float, power: float) -> tuple[Array, float, float]:
    """Axis (2,), ``g_1 - g_0`` and half angle of the cone that meets the circle, ``u' L (b b' - power I) L u > 0``."""
    inner = np.array([[(r - b[1]) * (r + b[1]), b[0] * b[1]], [b[0] * b[1], (r - b[0]) * (r + b[0])]])
    values, vectors = np.linalg.eigh(sigma[:, None] * inner * sigma)
    low, high = float(values[0]), float(values[1])
    # det G is known without cancellation, so that of the two eigenvalues the smaller follows from the larger.
    determinant = -(float(sigma.prod() * r) ** 2) * power
    if -low > high:
        high = determinant / low
    elif high > 0:
        low = determinant / high
    axis = vectors[:, 1] * -np.sign(b @ (sigma * vectors[:, 1]))  # of the two opposite cones the one towards the circle
    return axis, high - low, math.atan2(math.sqrt(high), math.sqrt(-low)) if high > 0 else 0.0


def _ascending_points(*points: Array) -> Array:
    # NumPy's own `unique` loads its masked arrays first, 30 ms of a cold start.
    return np.array(sorted({float(point) for group in points for point in group}))


def _log_integral(minus_log: Callable[[Array], Array], breaks: Array, negligible: float = 0.0) -> float:
    """``log Int exp(-minus_log(phi)) dphi`` over the panels between the breaks, by the double-exponential rule.

    The step is halved until the integral changes by less than 1e-12 of itself, or by less than ``negligible``; the
    finer of the two is much better than that.
    """
    start, width = breaks[:-1, None], np.diff(breaks)[:, None]
    previous = math.nan
    for level in range(3, 14):
        ends, weights = _double_exponential(level)
        with np.errstate(all="ignore"):  # a ray along an axis of zero width never ends
            lower, upper = minus_log(start + width * ends), minus_log(start + width - width * ends)
        values = np.nan_to_num(np.stack([lower, upper]), nan=math.inf, posinf=math.inf)
        least = float(values.min())
        if math.isinf(least):
            return -math.inf
        total = float((np.exp(least - values) * weights * width).sum())
        current = math.log(total) - least
        change = abs(current - previous)
        if change <= 1e-12 or change * math.exp(min(current, 0.0)) < negligible:
            return current
        previous = current
    raise SolverError("the integral for the probability of a miss did not converge")


@functools.cache
def _double_exponential(level: int) -> tuple[Array, Array]:
    """Half of the nodes on (0, 1), as distances from the end, and their weights, at the step ``2^-level``.

    ``x = 1 / (1 + exp(pi sinh t))`` at ``t = (j + 1/2) h``: the nodes crowd at both ends, where the integrand is sharp.
    """
    h = 0.5**level
    t = (np.arange(round(3.5 / h)) + 0.5) * h
    ends = 1 / (1 + np.exp(math.pi * np.sinh(t)))
    return ends, h * math.pi * np.cosh(t) * ends * (1 - ends)


def decreasing_root(f: Callable[[float], float], outer: float, inner: float = 0.0, *, enough: float = 0.0) -> float:
    """The root of f, ≤ 0 at ``outer``, ≥ 0 at ``inner``, by regula falsi that halves a stuck end (Illinois rule)."""
    outer_value, inner_value, side = f(outer), f(inner), 0
    for _ in range(200):
        if outer - inner <= 4e-16 * outer or outer_value == 0:
            break
        middle = (inner * outer_value - outer * inner_value) / (outer_value - inner_value)
        value = f(middle)
        if abs(value) <= enough:
            return middle
        if value > 0:
            inner, inner_value, outer_value, side = middle, value, outer_value / (2 if side > 0 else 1), 1
        else:
            outer, outer_value, inner_value, side = middle, value, inner_value / (2 if side < 0 else 1), -1
    return outer


def ball_probability(covariance: Array, radius: float, bias: Array, nodes: tuple[int, int] = (96, 64)) -> float:
    """``P(|x| ≤ r)`` of ``x ~ N(b, C)`` in space, C (3, 3) [m²] semidefinite, b (3,) [m].

    Along a direction u of the sphere ``x = b + ρ L u``, ``L Lᵀ = C``, is in the ball between its crossings ρ₁ < ρ₂, and
    ρ is beyond ρ₁ with the probability ``S(ρ) = erfc(ρ/√2) + √(2/π) ρ exp(−ρ²/2)`` (M. Abramowitz, I. A. Stegun, 1964,
    26.4.4). Averages: Gauss's rule in height about the longest axis, the trapezoid rule about it.
    The default ``nodes`` give seven digits for clearances of up to 20 σ.
    """
    variances, axes = np.linalg.eigh(np.asarray(covariance, dtype=float))
    sigma, b = np.sqrt(variances.clip(0.0)), axes.T @ np.asarray(bias, dtype=float)
    if not sigma[-1] > 0:
        return float(radius**2 - float(b @ b) >= 0)
    u, weights = _sphere_rule(*nodes)
    near, far = ray_crossings(b, u * sigma, radius)
    inside = (chi_tail(near, 3) if near.any() else 1.0) - chi_tail(far, 3)
    return float(np.clip(weights @ inside, 0.0, 1.0))


@functools.cache
def _sphere_rule(heights: int, turns: int) -> tuple[Array, Array]:
    """Directions (N, 3) and their weights (N,), the sum of which is 1."""
    height, share = np.polynomial.legendre.leggauss(heights)
    z, angle = (part.ravel() for part in np.meshgrid(height, TURN * np.arange(turns) / turns, indexing="ij"))
    across = np.sqrt(1 - z**2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), z]), np.repeat(share / 2 / turns, turns)


_erfc = np.vectorize(math.erfc, otypes=[float])  # SciPy's takes 0.3 s to import


def chi_tail(z: Array, m: int, erfc: Callable[[Array], Array] = _erfc) -> Array:
    """``P(chi > z)`` (N,) for m = 1, 2, 3 or 4 degrees of freedom, infinity allowed."""
    z = np.minimum(z, 40.0)
    tail = np.exp(-(z**2) / 2)
    if m % 2 == 0:
        return np.asarray(tail if m == 2 else tail * (1 + z**2 / 2))
    return np.asarray(erfc(z / math.sqrt(2)) + (0.0 if m == 1 else math.sqrt(2 / math.pi) * z * tail))


def ray_crossings(b: Array, d: Array, r: float) -> tuple[Array, Array]:
    """Where rays ``b + ρ d``, b (m,), d (N, m), enter the ball of radius r and leave it, ρ ≥ 0; 0 and 0 if never."""
    distance = float(np.linalg.norm(b))
    power = (r - distance) * (r + distance)
    A, B = (d**2).sum(axis=1), d @ b
    squared = B**2 + A * power
    with np.errstate(all="ignore"):
        root = np.sqrt(np.maximum(squared, 0.0))
        # Of the two forms of a root take the one that does not subtract.
        far = np.where(B > 0, power / (B + root), (root - B) / A)
        near = np.where(B > 0, -(root + B) / A, power / (B - root))
    still = A == 0
    far = np.where(still, math.inf if power >= 0 else 0.0, far)
    near = np.where(still | (power >= 0), 0.0, near)
    missed = ~still & (squared < 0)
    near, far = np.where(missed, 0.0, np.maximum(near, 0.0)), np.where(missed, 0.0, far)
    return near, np.maximum(far, near)


@dataclass(frozen=True)
class JointProbability:
    """Probability that two points stay within a clearance."""

    probability: float
    error: float  # twice its standard error by integration; 0 where the bounds meet


def both_within(covariance: Array, clearance: float, bias: Array) -> JointProbability:
    """The probability that two points, each of m = 1 or 2 coordinates, are within an interval or a circle.

    Of covariance (2 m, 2 m) [m²] and means (2 m,) [m], the first point first. With ``x = b + ρ A u``, ``A Aᵀ = C`` the
    ray in the direction u is inside of both from ``ρ₁(u)`` to ``ρ₂(u)``, and ``P = E_u[S(ρ₁) − S(ρ₂)]`` with the tail S
    of χ with 2 m degrees of freedom. The mean over directions is taken at a shifted lattice; the misses of each point
    alone are known exactly and bound it from both sides (Fréchet).
    """
    m = len(bias) // 2
    parts = slice(0, m), slice(m, 2 * m)
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    root = vectors * np.sqrt(np.clip(values, 0, None))
    alone = [miss_probability(covariance[k, k], clearance, bias[k]) for k in parts]
    means = []
    for u in _direction_sets(2 * m):
        steps = u @ root.T
        crossings = [ray_crossings(bias[k], steps[:, k], clearance) for k in parts]
        near, far = (np.array(ends) for ends in zip(*crossings, strict=True))
        first, last = near.max(axis=0), far.min(axis=0)
        means.append(float(np.mean(chi_tail(np.maximum(last, first), 2 * m) + 1 - chi_tail(first, 2 * m))))
    least, most = max(alone), min(sum(alone), 1.0)
    miss = float(np.clip(np.mean(means), least, most))
    error = 2 * float(np.std(means, ddof=1)) / math.sqrt(len(means))
    return JointProbability(1 - miss, min(error, most - least))


def _direction_sets(size: int, shifts: int = 8, count: int = 4096) -> list[Array]:
    """Sets (N, size) of unit vectors, each spread evenly over the circle or the sphere in 4D with its own shift."""
    rng, steps = np.random.default_rng(0), np.arange(count)[:, None]
    powers = np.array([0.8191725133961645, 0.6710436067037893, 0.5497004779019703])  # of the inverse root of x⁴ = x + 1
    sets = []
    for _ in range(shifts):
        if size == 2:
            angle = TURN * (steps[:, 0] + rng.uniform()) / count
            sets.append(np.column_stack([np.cos(angle), np.sin(angle)]))
            continue
        s, a, b = np.mod(steps * powers + rng.uniform(size=3), 1.0).T
        inner, outer, first, second = np.sqrt(s), np.sqrt(1 - s), TURN * a, TURN * b
        parts = inner * np.cos(first), inner * np.sin(first), outer * np.cos(second), outer * np.sin(second)
        sets.append(np.column_stack(parts))
    return sets


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


# The part of the spread: across the direction of the task, along it, or all of it
Within = Literal["across", "along", "all"]
# The parts by name, as sentences have them
PARTS: dict[str, str] = {"across": "across the direction", "along": "along the direction", "all": "in space"}


@dataclass(frozen=True)
class Critical(Encoded, json="within sigma_max basis covariance radius95"):
    """The part of the spread that counts for the task."""

    within: Within  # across the direction, along it, or all of it
    basis: Array  # (m, 3) unit vectors, one a row as in the documents, world
    covariance: Array  # (m, m) in that basis [m²]
    bias: Array  # (m,) mean shift in that basis [m]
    sigma_max: float  # largest standard deviation [m]
    worst_axis: Array  # (3,) the direction of it, world; its largest component is positive

    @classmethod
    def of(cls, within: Within, basis: Array, covariance: Array, bias: Array) -> Critical:
        """The part of a spread in a basis. basis: (3, m) orthonormal columns, world; covariance: (3, 3) [m²], world;
        bias: (3,) mean shift [m], world."""
        C, b = basis.T @ covariance @ basis, basis.T @ bias
        values, vectors = np.linalg.eigh(C)
        if values[-1] <= RANK_TOLERANCE * np.trace(covariance):
            C = np.zeros_like(C)  # what nothing moves: rounding
        worst = basis @ vectors[:, -1]
        worst = worst * np.sign(worst[np.argmax(np.abs(worst))])  # as the axes of an ellipse: a line, written one way
        sigma_max = deviation(float(values[-1]), covariance)
        return cls(within, basis.T, C, b, sigma_max, worst)

    @cached_property
    def radius95(self) -> float:
        """Distance from the target that 95 % of all tool points stay within [m]."""
        return coverage_radius(0.95, self.covariance, self.bias)
