"""Coverage factors, and the ellipses and ellipsoids that are drawn with them.

"Two sigma" holds 95 % on a line only: 86 % in the plane, 74 % in space. The number of sigmas that holds a
probability p depends on the dimension and, for a covariance estimated from n samples, on n and on the question.
SciPy takes a third of a second to import, so the factors that the command line always needs do without it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from posture_opt.errors import InputError
from posture_opt.numerics import TURN, Array, Mask

Kind = Literal["known", "mean", "prediction"]  # What a region is of, see `coverage_factor`

# Share of the largest variance below which there is none: J S J' has rounding noise of some 1e-15 of it
RANK_TOLERANCE = 1e-13
# Standard deviations that hold 95 % of a normal variable; its square is that quantile of χ² with one freedom
NORMAL95 = 1.959963984540054


def deviation(variance: float, among: Array) -> float:
    """The root [m] of a variance [m²] of the covariance ``among`` (m, m); rounding, 1e-16 of its trace, is zero."""
    return math.sqrt(variance) if variance > RANK_TOLERANCE * float(np.trace(among)) else 0.0


def coverage_factor(p: float, m: int, n: int | None = None, kind: Kind = "prediction") -> float:
    """The k of the region ``(y - c)' C^-1 (y - c) <= k^2`` of y (m,) that holds with probability p.

    With n Gaussian samples (mean c, sample covariance C of a *single* point, n - 1 in the denominator) three questions
    have three answers, ``k_H = hotelling_factor(p, m, n - 1)``: where the true ``mean`` lies, ``k = k_H / sqrt(n)``;
    where the next point will lie (``prediction``), ``k = k_H sqrt(1 + 1/n)``; for a ``known`` covariance about a known
    mean, as without n, ``k^2 = chi2_p(m)``.

    Source: H. Hotelling, Ann. Math. Stat. 2 (1931) 360; JCGM 102:2011, 6.5.2 and table 1 for the known covariance.
    """
    if n is None and kind == "mean":
        raise InputError("where the true mean lies depends on the number of samples, and none was given")
    if n is None or kind == "known":
        return _chi_quantile(p, m)
    hotelling = hotelling_factor(p, m, n - 1)
    return hotelling / math.sqrt(n) if kind == "mean" else hotelling * math.sqrt(1 + 1 / n)


def hotelling_factor(p: float, m: int, dof: float) -> float:
    """The k of ``(y - mu)' S^-1 (y - mu) <= k^2`` for an estimate y whose own covariance S was estimated.

    ``k^2 = m nu / (nu + 1 - m) F_p(m, nu + 1 - m)``; in the plane ``k^2 = nu ((1 - p)^(-2 / (nu - 1)) - 1)``. The
    degrees of freedom nu need not be whole; infinity gives the chi factor. Source: H. Hotelling (1931).
    """
    _check_region(p, m)
    rest = dof + 1 - m
    if not rest > 0:
        raise InputError(f"a region in {m} dimensions needs more than {m} samples, there are {dof + 1:g}")
    if math.isinf(dof):
        return _chi_quantile(p, m)
    if m == 2:
        return math.sqrt(dof * math.expm1(-2 / rest * math.log1p(-p)))
    from scipy.special import fdtri

    return math.sqrt(m * dof / rest * float(fdtri(m, rest, p)))


def coverage_probability(k: float, m: int) -> float:
    """The probability within k sigma of a known covariance, ``P(chi2(m) <= k^2)``; ``1 - exp(-k^2 / 2)`` for m = 2."""
    return _chi_tails(k, m)[0] if k > 0 else 0.0


def standard_deviation_interval(n: int, p: float = 0.95) -> tuple[float, float]:
    """``sqrt(nu / chi2_(1±p)/2(nu))``, ``nu = n - 1``: the true σ over that of n samples, at probability p."""
    nu = n - 1
    return math.sqrt(nu) / _chi_quantile((1 + p) / 2, nu), math.sqrt(nu) / _chi_quantile((1 - p) / 2, nu)


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """The region of a Gaussian point: ``(y - center)' covariance^-1 (y - center) <= k^2``.

    A covariance of rank r (a planar arm in space, a singular posture) has its region in the subspace that it spans, and
    k is the one for r dimensions.
    """

    center: Array  # (m,) the mean
    covariance: Array  # (m, m) symmetric, in squares of its unit; eigenvalues below zero by rounding count as zero

    @property
    def semi_axes(self) -> Array:
        """(m,) standard deviations along the axes, ascending: the roots of the eigenvalues, zero where `rank` ends."""
        return self._principal_axes[0]

    @property
    def axes(self) -> Array:
        """(m, m) unit vectors in columns, ``axes[:, i]`` along ``semi_axes[i]``; their largest entry is positive."""
        return self._principal_axes[1]

    @property
    def rank(self) -> int:
        """The number of directions with a variance above rounding (1e-13 of the largest)."""
        return int(np.count_nonzero(self.semi_axes))

    def factor(self, p: float, n: int | None = None, kind: Kind = "prediction") -> float:
        """The k of the region that holds with probability p, for `rank` dimensions; zero for a point."""
        return coverage_factor(p, self.rank, n, kind) if self.rank else 0.0

    def region(self, p: float, n: int | None = None, kind: Kind = "prediction") -> Array:
        """(m,) semi-axes, ascending, of the region that holds with probability p; see `coverage_factor`."""
        return self.semi_axes * self.factor(p, n, kind)

    def project(self, directions: ArrayLike) -> Ellipsoid:
        """The ellipsoid of ``B y``, B (k, m) or (m,), whose region has the factor of its own, lower dimension."""
        rows = np.atleast_2d(np.asarray(directions, dtype=float))
        return Ellipsoid(rows @ self.center, rows @ self.covariance @ rows.T)

    def mahalanobis(self, points: ArrayLike) -> Array:
        """(N,) distances ``sqrt((y - center)' C^+ (y - center))`` of points (N, m); infinite off the subspace of C."""
        offset = np.atleast_2d(np.asarray(points, dtype=float)) - self.center
        sigma, axes = self._principal_axes
        rank = self.rank
        null, span = np.split(offset @ axes, [len(sigma) - rank], axis=1)
        distance: Array = np.linalg.norm(span / sigma[len(sigma) - rank :], axis=1)
        # Off the subspace is what lies ten times as far out as a deviation that counts as none, and beyond rounding.
        reach = 10 * math.sqrt(RANK_TOLERANCE) * sigma[-1] + 1e-14 * float(np.abs(self.center).max())
        distance[(np.abs(null) > reach).any(axis=1)] = math.inf
        return distance

    def contains(self, points: ArrayLike, p: float) -> Mask:
        """(N,) whether each of points (N, m) lies in the region of probability p."""
        return self.mahalanobis(points) <= self.factor(p)

    def points(self, p: float, n: int = 121) -> Array:
        """(n, 2) the boundary of a plane region, counter-clockwise from the major axis, first and last point equal."""
        if len(self.center) != 2:
            raise InputError(f"only a plane ellipse has a boundary curve; this one has {len(self.center)} dimensions")
        minor, major = self.region(p)
        along = self.axes[:, 1]
        across = np.array([-along[1], along[0]])
        angle = np.linspace(0, TURN, n)[:, None]
        boundary: Array = self.center + major * np.cos(angle) * along + minor * np.sin(angle) * across
        boundary[-1] = boundary[0]
        return boundary

    @cached_property
    def _principal_axes(self) -> tuple[Array, Array]:
        """Standard deviations (m,), ascending, and unit vectors (m, m) in columns, both read-only."""
        symmetric = (self.covariance + self.covariance.T) / 2
        variances, axes = np.linalg.eigh(symmetric)
        largest = np.abs(axes).argmax(axis=0)
        signs = np.sign(axes[largest, np.arange(len(variances))])
        # An axis that is no variance but rounding has no width.
        kept = np.where(variances > RANK_TOLERANCE * variances[-1], variances, 0.0)
        semi_axes, axes = np.sqrt(kept), axes * signs
        semi_axes.setflags(write=False)
        axes.setflags(write=False)
        return semi_axes, axes


def _check_region(p: float, m: int) -> None:
    if not 0 < p < 1:
        raise InputError(f"a coverage probability lies between 0 and 1, not at {p:g}")
    if m < 1:
        raise InputError(f"a region needs at least one dimension, not {m}")


def _chi_quantile(p: float, m: int) -> float:
    """The k with ``P(chi <= k) = p`` for m degrees of freedom."""
    _check_region(p, m)
    if m == 1:
        return -NormalDist().inv_cdf((1 - p) / 2)
    if m == 2:
        return math.sqrt(-2 * math.log1p(-p))
    # Newton on the logarithm of the smaller tail: it is concave in k, so that from the second step on the iterates
    # approach the root from one side. The start is that of E. B. Wilson and M. M. Hilferty, PNAS 17 (1931) 684.
    k = math.sqrt(m) * math.pow(max(1 - 2 / (9 * m) + NormalDist().inv_cdf(p) * math.sqrt(2 / (9 * m)), 0.1), 1.5)
    for _ in range(60):
        lower, upper = _chi_tails(k, m)
        log_density = (m - 1) * math.log(k) - k * k / 2 - (m / 2 - 1) * math.log(2) - math.lgamma(m / 2)
        tail, error = (upper, math.log(upper / (1 - p))) if p > 0.5 else (lower, -math.log(lower / p))
        step = error * tail / math.exp(log_density)
        k = max(k + step, k / 4)
        if abs(step) < 1e-14 * k:
            break
    return k


def _chi_tails(k: float, m: int) -> tuple[float, float]:
    """``P(chi <= k)`` and ``P(chi > k)`` for m degrees of freedom, the smaller of the two without cancellation."""
    h = k * k / 2
    # Q(a + 1, h) = Q(a, h) + h^a e^-h / Gamma(a + 1) up to a = m/2: Abramowitz & Stegun (1964), 26.4.4 and 26.4.5.
    a, upper = (0.5, math.erfc(math.sqrt(h))) if m % 2 else (1.0, math.exp(-h))
    while a < m / 2:
        upper += math.exp(a * math.log(h) - h - math.lgamma(a + 1))
        a += 1
    if upper < 0.5:
        return 1 - upper, upper
    term = lower = math.exp(a * math.log(h) - h - math.lgamma(a + 1))
    while term > 1e-17 * lower:
        a += 1
        term *= h / a
        lower += term
    return lower, upper
