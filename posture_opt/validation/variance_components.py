"""Variance components: scatter whose covariance is a sum of known matrices with unknown variances.

``C_g(θ) = known_g + Σ_c θ_c M_cg`` at each of G postures, with sums of squares A_g of ν_g degrees of freedom. The
log-likelihood ``−½ Σ_g (ν_g log|C_g| + tr(C_g⁻¹ A_g))`` is maximised over ``θ ≥ 0`` by Fisher scoring.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from posture_opt.numerics import Array, Mask
from posture_opt.uncertainty.regions.regions import NORMAL95
from posture_opt.validation.scatter_model import Scatter

_MAX_SCORING_STEPS = 200  # of Fisher scoring; five to twenty suffice
_LIKELIHOOD_TOLERANCE = 1e-8  # of log-likelihood: what a further step would gain
_PROFILE_TOLERANCE = 1e-3  # the same where an interval of 95 % is sought
_MIN_ERROR_M = 1e-12  # m: less is rounding
_MIN_INSTRUMENT_SHARE = 1e-6  # of the RMS error: an instrument of exactly no noise would make singular covariances
_MIN_LEVER_SHARE = 1e-9  # of the longest lever: a joint that moves nothing
_UNDETERMINED_SHARE = 0.05  # of an undetermined direction: a smaller part does not spoil a component
_QUADRATIC_FREEDOM = 200.0  # degrees of freedom: from there on the likelihood is quadratic in log σ
_INTERVAL_TOLERANCE = 0.03  # of the root of χ²: how exactly the end of an interval is found


@dataclass(frozen=True, eq=False)
class Components:
    """Variances θ (c,) and the covariance ``known + Σ θ_c M_c`` that is linear in them.

    Args:
        scatter: sums of squares with their degrees of freedom.
        member: (n, c) which component each joint's variance is; the instrument's is the last where it is fitted.
        fixed: variance of the instrument that is taken as known [m²], or the floor that its component is counted from.
        fitted: whether the instrument's variance is a component.
    """

    scatter: Scatter
    member: Array
    fixed: float
    fitted: bool

    @classmethod
    def of(cls, scatter: Scatter, names: tuple[str, ...], instrument: float, fitted: bool, equal: bool) -> Components:
        """One component a joint, or one for all turning joints if ``equal``; the instrument's if ``fitted``."""
        alike = np.array([equal and not name.endswith(".d") for name in names])
        member = np.eye(len(names))
        if alike.any():
            common = alike.astype(float)[:, None]
            member = np.concatenate([common, member[:, ~alike]], axis=1)
        member = np.concatenate([member, np.zeros((len(names), int(fitted)))], axis=1)
        floor = _MIN_INSTRUMENT_SHARE**2 * _mean_square(scatter)
        return cls(scatter, member, max(0.0 if fitted else instrument**2, floor), fitted)

    @property
    def size(self) -> int:
        """The number c of components."""
        return int(self.member.shape[1])

    def start(self) -> Array:
        """Every component as large as would explain its part of all scatter.

        A variance that moves nothing starts at zero.
        """
        levers = np.einsum("gdn,gdn->n", self.scatter.columns, self.scatter.columns) @ self.member
        levers /= len(self.scatter.columns) * self.scatter.squares.shape[1]
        if self.fitted:
            levers[-1] = 1.0
        total = _mean_square(self.scatter)
        moving = levers > _MIN_LEVER_SHARE**2 * levers.max(initial=0.0)
        return np.asarray(np.divide(total, self.size * levers, out=np.zeros(self.size), where=moving))

    @cached_property
    def parts(self) -> Array:
        """(c, G d d) the matrices M_c of all postures."""
        J = np.moveaxis(self.scatter.columns, 2, 0)
        each = (J[:, :, :, None] * J[:, :, None, :]).reshape(len(J), -1)
        found = self.member.T @ each
        if self.fitted:
            found[-1] = np.broadcast_to(np.eye(J.shape[2]), self.scatter.squares.shape).ravel()
        return np.asarray(found)

    def covariance(self, theta: Array) -> Array:
        """Covariances (G, d, d) [m²] at variances θ (c,)."""
        return np.asarray((theta @ self.parts).reshape(self.scatter.squares.shape) + self.known)

    @cached_property
    def known(self) -> Array:
        """(G or 1, d, d) what does not depend on the variances."""
        return np.asarray(self.fixed * np.eye(self.scatter.squares.shape[1]) + self.scatter.known)

    def log_likelihood(self, theta: Array) -> float:
        """The log-likelihood of all scatter at variances θ (c,); −∞ where a covariance is singular."""
        return float(self.scatter.log_likelihoods(self.covariance(theta)).sum())

    def normal(self, theta: Array) -> tuple[Array, Array]:
        """Expected information (c, c), and u (c,): the scoring step goes to ``θ`` with ``I θ = u``.

        ``I_ab = ½ Σ_g ν_g tr(C⁻¹ M_a C⁻¹ M_b)`` and ``u_a = ½ Σ_g tr(C⁻¹ M_a C⁻¹ (A_g − ν_g known))``.
        """
        J, nu = self.scatter.columns, self.scatter.freedom
        inverse = np.linalg.inv(self.covariance(theta))
        W = inverse @ J
        between = np.swapaxes(J, -1, -2) @ W
        weighted = self.scatter.squares - nu[:, None, None] * self.known
        information = self.member.T @ (np.tensordot(nu, between**2, axes=1) / 2) @ self.member
        if self.fitted:
            across = self.member.T @ (np.tensordot(nu, np.sum(W**2, axis=1), axes=1) / 2)
            information[-1], information[:, -1] = across, across
            information[-1, -1] = nu @ np.sum(inverse**2, axis=(1, 2)) / 2
        return information, np.asarray(self.parts @ (inverse @ weighted @ inverse).ravel() / 2)

    def maximise(self, theta: Array, held: int | None = None) -> tuple[Array, float]:
        """The likeliest variances, and their log-likelihood; the component ``held`` keeps its value.

        Steps are halved until the likelihood does not fall; `_MAX_SCORING_STEPS` at the most.
        """
        value = self.log_likelihood(theta)
        if not np.isfinite(value):  # a covariance that is singular in floats
            return theta, value
        free = np.arange(self.size) != (-1 if held is None else held)
        for _ in range(_MAX_SCORING_STEPS):
            step = self._scoring(theta, free) - theta
            before, size = value, 1.0
            while size > 1e-6:
                tried = np.maximum(theta + size * step, 0.0)
                value = self.log_likelihood(tried)
                if value >= before and np.isfinite(value):
                    theta = tried
                    break
                size /= 2
            value = max(value, before)
            if value - before <= (_LIKELIHOOD_TOLERANCE if held is None else _PROFILE_TOLERANCE):
                break
        return theta, value

    def _scoring(self, theta: Array, free: Mask) -> Array:
        """Where a step of Fisher scoring leads, all variances kept at zero or above.

        Least squares with ``θ ≥ 0`` (Lawson, Hanson 1974) on the roots of the information, in units of its diagonal.
        """
        from scipy.optimize import nnls

        information, u = self.normal(theta)
        if not free.any():
            return theta
        u = u[free] - information[np.ix_(free, ~free)] @ theta[~free]
        information = information[np.ix_(free, free)]
        scale = _unit_diagonal(information)
        values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
        known = values > 1e-12 * max(values[-1], 1e-300)
        roots = np.sqrt(values[known])
        A, b = roots[:, None] * vectors[:, known].T, (vectors[:, known].T @ (u * scale)) / roots
        moved = theta.copy()
        moved[free] = nnls(A, b)[0] * scale
        return moved

    def errors(self, theta: Array) -> Array:
        """(c,) standard errors of the variances; infinite where the data do not determine them.

        Directions of the scaled information below 1e-9 of the largest are unseen; a component with a part in one has no
        error.
        """
        information = self.normal(theta)[0]
        scale = _unit_diagonal(information)
        values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
        known = values > 1e-9 * max(values[-1], 1e-300)
        spread = np.sum(vectors[:, known] ** 2 / values[known], axis=1)
        lost = np.linalg.norm(vectors[:, ~known], axis=1) > _UNDETERMINED_SHARE
        return np.where(lost | (np.diag(information) <= 0), np.inf, np.sqrt(spread) * scale)

    def interval(self, theta: Array, best: float, k: int, error: float) -> tuple[float, float]:
        """The 95 % interval of one variance: where the others, made likeliest, leave the likelihood high enough.

        Where the data determine it well, ``exp(± 1.96 error/θ)`` about θ, as the likelihood is quadratic in log σ
        there.
        """
        if not np.isfinite(error):
            return 0.0, np.inf
        if theta[k] > 0 and 2 * (theta[k] / error) ** 2 > _QUADRATIC_FREEDOM:
            spread = np.exp(NORMAL95 * error / theta[k])
            return float(theta[k] / spread), float(theta[k] * spread)
        return self._interval_end(theta, best, k, error, -1), self._interval_end(theta, best, k, error, 1)

    def _interval_end(self, theta: Array, best: float, k: int, error: float, side: int) -> float:
        """Where the profile of the likelihood falls by half the 95 % quantile of χ².

        The root of the fall is nearly linear in the variance: regula falsi, with the Illinois rule, is quick.
        """
        near, enough = theta, NORMAL95

        def beyond(value: float) -> float:
            nonlocal near
            start = near.copy()
            start[k] = value
            near, likelihood = self.maximise(start, held=k)
            return float(np.sqrt(max(2 * (best - likelihood), 0.0)) - enough)

        inside, low, step = float(theta[k]), -enough, 2 * error
        while True:
            outside = max(inside + side * step, 0.0)
            high = beyond(outside)
            if high > 0:
                return _illinois_root(beyond, (inside, low), (outside, high))
            if outside == 0:
                return 0.0
            inside, low, step = outside, high, 2 * step


def _illinois_root(
    function: Callable[[float], float], inside: tuple[float, float], outside: tuple[float, float]
) -> float:
    """Where a function crosses zero between two points (x, f(x)), f below zero at the first and above at the other.

    Source: Dowell, Jarratt (1971), the Illinois rule.
    """
    (a, low), (b, high) = inside, outside
    former, middle = None, b
    for _ in range(_MAX_SCORING_STEPS):
        middle = (a * high - b * low) / (high - low)
        found = function(middle)
        if abs(found) < _INTERVAL_TOLERANCE:
            break
        kept = found > 0
        if kept == former:  # twice on one side: the other end weighs half
            low, high = (low / 2, high) if kept else (low, high / 2)
        former = kept
        if kept:
            b, high = middle, found
        else:
            a, low = middle, found
    return float(middle)


def _mean_square(scatter: Scatter) -> float:
    """The mean square of a coordinate of the scatter [m²], 1e-24 at the least."""
    total = float(np.trace(scatter.squares, axis1=-2, axis2=-1).sum())
    return max(total / float(scatter.freedom.sum() * scatter.squares.shape[1]), _MIN_ERROR_M**2)


def _unit_diagonal(information: Array) -> Array:
    """Factors (c,) that make the diagonal of an information matrix one; 1 where it is zero."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    return np.divide(1.0, size, out=np.ones_like(size), where=size > 0)
