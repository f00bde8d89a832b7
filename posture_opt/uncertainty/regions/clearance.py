"""The probability that a biased Gaussian point stays within a radial clearance: will the peg meet the hole?

``|x|^2`` of ``x ~ N(b, C)`` is a quadratic form of normals. Its distribution is computed, not sampled: a peg that
misses once in 10^30 gets that number, and an optimiser gets a smooth one.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from posture_opt.errors import InputError, SolverError
from posture_opt.numerics import Array
from posture_opt.uncertainty.regions.ball import ball_probability
from posture_opt.uncertainty.regions.regions import coverage_factor

_QUADRATURE_TOLERANCE = (
    1e-12  # relative, between two steps of the quadrature; the finer of the two is much better than that
)
"""Relative change between two steps of the quadrature; the finer of the two is much better than that."""
_INNER_MARGIN = 1e-9  # of a bound that rounding may put on the other side of what it bounds


def miss_probability(covariance: ArrayLike, clearance: float, bias: ArrayLike | None = None) -> float:
    """The probability that a Gaussian point lies farther than the clearance from the origin.

    ``P = 1/(2 pi) Int exp(-rho(phi)^2 / 2) dphi`` with ``|b + rho L u(phi)| = r``, ``L L' = C``,
    ``u = (cos phi, sin phi)``: in polar coordinates the radius of a standard normal point exceeds rho with probability
    ``exp(-rho^2 / 2)``. On a line (m = 1, or C of rank one) this is ``Phi((b - r) / s) + Phi((-b - r) / s)`` by
    J. W. Craig's form of the normal tail.

    Args:
        covariance: (m, m) [m^2], m = 1 or 2, positive semidefinite; zero is allowed.
        clearance: r >= 0 [m].
        bias: (m,) b [m], mean of the point; zero if left out.

    Raises:
        InputError: m > 2, shapes that do not fit, a number that is not finite, or a negative clearance.
        SolverError: the quadrature does not converge.

    Source: J. W. Craig, IEEE MILCOM (1991) 571; H. Takahasi and M. Mori, Publ. RIMS 9 (1974) 721 (quadrature).
    """
    return math.exp(log_miss_probability(covariance, clearance, bias))


def success_probability(covariance: ArrayLike, clearance: float, bias: ArrayLike | None = None) -> float:
    """The probability that a Gaussian point lies within the clearance, ``1 - miss_probability``; arguments as there.

    Example:
        >>> print(f"{success_probability([[1.0, 0.0], [0.0, 1.0]], 2.0):.4f}")
        0.8647
    """
    return -math.expm1(log_miss_probability(covariance, clearance, bias))


def within_clearance(covariance: Array, clearance: float, bias: Array) -> float | None:
    """`success_probability` of the part of a spread that counts for a task; None without a clearance (NaN).

    In space the clearance is the radius of a ball about the target.

    Args:
        covariance: (m, m) [m²], m = 1, 2 or 3.
        clearance: [m], NaN without one.
        bias: (m,) [m].
    """
    if math.isnan(clearance):
        return None
    if len(covariance) > 2:
        return ball_probability(covariance, clearance, bias)
    return success_probability(covariance, clearance, bias)


def log_miss_probability(covariance: ArrayLike, clearance: float, bias: ArrayLike | None = None) -> float:
    """The natural logarithm of `miss_probability`; it goes on where the probability itself is below 1e-308.

    Raises:
        InputError, SolverError: as `miss_probability`.
    """
    sigma, b = _principal_axes(covariance, bias)
    if not clearance >= 0:
        raise InputError(f"a clearance is a length of zero or more, not {clearance:g}")
    return _log_miss(sigma, b, clearance)


def radius_for(p: float, covariance: ArrayLike, bias: ArrayLike | None = None) -> float:
    """The radius about the origin that holds a biased Gaussian point with probability p [m].

    The root r of ``miss_probability(C, r, b) = 1 - p``; ``radius_for(0.95, C)`` is the radius R95.

    Args:
        p: probability, 0 < p < 1.
        covariance: (m, m) [m^2], m = 1 or 2.
        bias: (m,) [m]; zero if left out.

    Raises:
        InputError: as `miss_probability`, or p outside (0, 1).

    Example:
        >>> print(f"{radius_for(0.95, [[1.0, 0.0], [0.0, 1.0]]):.4f}")
        2.4477
    """
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
    inner = float((1 - _INNER_MARGIN) * sigma[0] * coverage_factor(p, 1))
    square = decreasing_root(
        lambda s: _log_miss(sigma, b, math.sqrt(s)) - goal, outer**2, inner**2, enough=_QUADRATURE_TOLERANCE / 10
    )
    return math.sqrt(square)


def _principal_axes(covariance: ArrayLike, bias: ArrayLike | None) -> tuple[Array, Array]:
    """Standard deviations (2,) [m], descending, and the mean (2,) [m] in the principal axes; a line gets a zero axis.

    Raises:
        InputError: shapes that do not fit, or numbers that are not finite.
    """
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
    """All points once, in order; NumPy's own `unique` loads its masked arrays first, 30 ms of a cold start."""
    return np.array(sorted({float(point) for group in points for point in group}))


def _log_integral(minus_log: Callable[[Array], Array], breaks: Array, negligible: float = 0.0) -> float:
    """``log Int exp(-minus_log(phi)) dphi`` over the panels between the breaks, by the double-exponential rule.

    The step is halved until the integral changes by less than 1e-12 of itself, or by less than ``negligible``.
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
        if change <= _QUADRATURE_TOLERANCE or change * math.exp(min(current, 0.0)) < negligible:
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
    """The root of a decreasing f between two ends by regula falsi that halves a stuck end (the Illinois rule).

    Args:
        f: decreasing, not positive at ``outer`` and not negative at ``inner``.
        outer: upper end; the answer is good to rounding.
        inner: lower end.
        enough: a value of f that is as good as zero.
    """
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
