"""The scatter of the joints from the scatter of the tool point: variance components by (restricted) likelihood.

Joint errors that change from visit to visit spread the tool point by ``J diag(σ²) Jᵀ``, differently at every
posture, and the instrument adds ``s² I`` everywhere: postures with different ``J`` tell the joints from each other
and from the instrument (Brethé, Vasselin, Lefebvre, Dakyo 2005: stochastic ellipsoids).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from posture_opt.errors import InsufficientDataError

Array = NDArray[np.float64]
Codes = NDArray[np.intp]

_STEPS = 200  # of Fisher scoring; five to twenty settle it
_SETTLED = 1e-8  # of log-likelihood: what a further step would gain
_ROUGH = 1e-4  # the same where an interval of 95 % is sought
_FLOOR = 1e-6  # of the RMS error: an instrument of exactly no noise would make singular covariances
_IDLE = 1e-9  # of the longest lever: a joint that moves nothing
_PART = 0.05  # of an undetermined direction: a smaller part does not spoil a component
_PLAIN = 200.0  # degrees of freedom: from there on the likelihood is quadratic in log σ
_NEAR = 0.01  # of the root of χ²: how exactly the end of an interval is found
_CHI2 = 3.841458820694124  # 95 % of χ² with one degree of freedom


@dataclass(frozen=True, eq=False)
class JointNoise:
    """Standard deviations of the joints and of the instrument.

    Args:
        names: (n,) the joints' errors, ``JOINT.theta`` or ``JOINT.d``.
        sigma: (n,) standard deviations [rad, m], 0 or more.
        std: (n,) standard errors of ``sigma``; of a σ of 0, by how much it may be more; infinite where the data
            do not tell.
        interval: (n, 2) 95 % intervals of ``sigma`` by the profile likelihood.
        instrument, instrument_std: the instrument's standard deviation of a coordinate [m], error 0 where it was
            given; ``instrument_interval`` as above.
        log_likelihood: at the maximum; of the contrasts within groups where there are groups.
        freedom: independent measured coordinates that it is made of.
        restricted: whether group means were unknown.
    """

    names: tuple[str, ...]
    sigma: Array
    std: Array
    interval: Array
    instrument: float
    instrument_std: float
    instrument_interval: tuple[float, float]
    log_likelihood: float
    freedom: int
    restricted: bool

    def covariance(self, columns: Array) -> Array:
        """``s² I + J diag(σ²) Jᵀ`` (N, d, d) [m²] at the postures of ``columns`` (N, d, n) [m/rad, m/m]."""
        return covariances(columns, self.sigma, self.instrument)

    @property
    def determined(self) -> NDArray[np.bool_]:
        """(n,) whether the data tell each σ."""
        return np.isfinite(self.std)


@dataclass(frozen=True, eq=False)
class Scatter:
    """What a Gaussian likelihood needs to know of errors that scatter about unknown or zero means.

    Args:
        columns: (G, d, n) ``∂x/∂joint`` at each posture.
        squares: (G, d, d) sums of squares and products [m²].
        freedom: (G,) of each: rows less one where the mean is unknown.
    """

    columns: Array
    squares: Array
    freedom: Array

    @classmethod
    def of(cls, errors: Array, columns: Array, groups: Codes | None = None) -> Scatter:
        """Of errors (N, d) about zero, or about the means of ``groups`` (N,): rows of one posture.

        Within a group of one posture all contrasts have the same covariance, so that their squares are enough.
        Groups of a single row say nothing about scatter and are left out.
        """
        if groups is None:
            return cls(columns, errors[:, :, None] * errors[:, None, :], np.ones(len(errors)))
        _, first, code, count = np.unique(groups, return_index=True, return_inverse=True, return_counts=True)
        mean = _sums(errors, code, len(count)) / count[:, None]
        centred = errors - mean[code]
        squares = _sums(centred[:, :, None] * centred[:, None, :], code, len(count))
        many = count > 1
        return cls(columns[first[many]], squares[many], np.asarray(count[many] - 1.0))

    def take(self, cases: Any) -> Scatter:
        """Some of the postures."""
        return Scatter(self.columns[cases], self.squares[cases], self.freedom[cases])

    def log_likelihoods(self, covariance: Array) -> Array:
        """(G,) log-likelihoods of normal scatter with covariances (G, d, d) or (d, d) [m²]."""
        d = self.squares.shape[-1]
        sizes = np.linalg.slogdet(covariance)[1] + d * np.log(2 * np.pi)
        distance = np.sum(np.linalg.inv(covariance) * self.squares, axis=(-2, -1))
        return np.asarray(-0.5 * (self.freedom * sizes + distance))


def covariances(columns: Array, sigma: Array, instrument: float) -> Array:
    """``s² I + J diag(σ²) Jᵀ`` (N, d, d) [m²]."""
    scaled = columns * sigma
    return np.asarray(scaled @ np.swapaxes(scaled, -1, -2) + instrument**2 * np.eye(columns.shape[1]))


def estimate_joint_noise(
    errors: Array,
    columns: Array,
    *,
    groups: Codes | None = None,
    instrument: float,
    fit_instrument: bool = False,
    equal: bool = False,
    names: Sequence[str] = (),
) -> JointNoise:
    """Standard deviations of the joints that make measured errors likeliest.

    ``error ~ N(μ_group or 0, s² I + J diag(σ²) Jᵀ)`` with ``σ ≥ 0``. The restricted likelihood (Patterson,
    Thompson 1971) of the contrasts within groups does not know the group means. Fisher scoring on the variances,
    each step a non-negative least squares problem: the covariance is linear in them, so that the step to
    ``θ = I(θ)⁻¹ u(θ)`` is the Newton step with the expected information (Searle, Casella, McCulloch 1992, 6.6).

    Args:
        errors: (N, d) [m], d = 1, 2 or 3.
        columns: (N, d, n) shift of the tool point by a unit of each joint's error [m/rad, m/m].
        groups: (N,) rows of one code repeat one posture; ``None`` takes the errors to be about zero.
        instrument: standard deviation s of a measured coordinate [m]; a start where ``fit_instrument``.
        equal: one standard deviation for all joints whose name does not end in ``.d``.
        names: (n,) the joints' errors.

    Raises:
        InsufficientDataError: no group has two rows, or fewer coordinates than unknowns.
    """
    named = tuple(names) or tuple(f"joint{i + 1}.theta" for i in range(columns.shape[2]))
    scatter = Scatter.of(np.asarray(errors, dtype=float), np.asarray(columns, dtype=float), groups)
    if not len(scatter.freedom):
        raise InsufficientDataError("no posture was measured twice: repeat some postures to see their scatter")
    return fit_scatter(scatter, named, instrument, fit_instrument, equal, groups is not None)


def fit_scatter(
    scatter: Scatter,
    names: tuple[str, ...],
    instrument: float,
    fit_instrument: bool = False,
    equal: bool = False,
    restricted: bool = True,
) -> JointNoise:
    """:func:`estimate_joint_noise` from sums of squares."""
    model = _Components.of(scatter, names, instrument, fit_instrument, equal)
    freedom = int(scatter.freedom.sum()) * scatter.squares.shape[1]
    if freedom < model.size:
        need = int(np.ceil(model.size / scatter.squares.shape[1]))
        raise InsufficientDataError(
            f"{freedom} coordinates of scatter cannot determine {model.size} standard deviations: measure at least "
            f"{need} more repeats, at different postures"
        )
    theta, best = model.maximise(model.start())
    error = model.errors(theta)
    ends = np.array([model.interval(theta, best, k, error[k]) for k in range(model.size)]).reshape(-1, 2)
    joints = model.member.argmax(axis=1)
    sigma, std = np.sqrt(theta), _std_of_root(theta, error)
    last = model.size - 1
    fitted = (
        (float(np.sqrt(theta[last] + model.fixed)), float(std[last])) if fit_instrument else (model.fixed**0.5, 0.0)
    )
    low, high = np.sqrt(ends[last] + model.fixed) if fit_instrument else (fitted[0], fitted[0])
    return JointNoise(
        names=names,
        sigma=sigma[joints],
        std=std[joints],
        interval=np.sqrt(ends)[joints],
        instrument=fitted[0],
        instrument_std=fitted[1],
        instrument_interval=(float(low), float(high)),
        log_likelihood=best,
        freedom=freedom,
        restricted=restricted,
    )


def _std_of_root(theta: Array, error: Array) -> Array:
    """Standard errors of the roots of variances; near zero, where a tangent says nothing, the root of the error."""
    finite = np.where(np.isfinite(error), error, 0.0)
    steep = 2 * np.maximum(np.sqrt(theta), np.sqrt(finite) / 2)
    found = np.divide(finite, steep, out=np.zeros_like(finite), where=steep > 0)
    return np.where(np.isfinite(error), found, np.inf)


def _sums(values: Array, code: Codes, count: int) -> Array:
    found = np.zeros((count, *values.shape[1:]))
    np.add.at(found, code, values)
    return found


@dataclass(frozen=True, eq=False)
class _Components:
    """Variances θ (c,) and the covariance ``fixed I + Σ θ_c M_c`` that is linear in them.

    ``member`` (n, c) says which component each joint's variance is; the instrument's is the last where it is
    fitted, counted from ``fixed``.
    """

    scatter: Scatter
    member: Array
    fixed: float
    fitted: bool

    @classmethod
    def of(cls, scatter: Scatter, names: tuple[str, ...], instrument: float, fitted: bool, equal: bool) -> _Components:
        alike = np.array([equal and not name.endswith(".d") for name in names])
        member = np.eye(len(names))
        if alike.any():
            common = alike.astype(float)[:, None]
            member = np.concatenate([common, member[:, ~alike]], axis=1)
        member = np.concatenate([member, np.zeros((len(names), int(fitted)))], axis=1)
        floor = _FLOOR**2 * _mean_square(scatter)
        return cls(scatter, member, max(0.0 if fitted else instrument**2, floor), fitted)

    @property
    def size(self) -> int:
        return int(self.member.shape[1])

    def start(self) -> Array:
        """Every component as large as would explain its part of all scatter."""
        levers = np.einsum("gdn,gdn->n", self.scatter.columns, self.scatter.columns) @ self.member
        levers /= len(self.scatter.columns) * self.scatter.squares.shape[1]
        if self.fitted:
            levers[-1] = 1.0
        total = _mean_square(self.scatter)
        moving = levers > _IDLE**2 * levers.max(initial=0.0)
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
        known = self.fixed * np.eye(self.scatter.squares.shape[1])
        return np.asarray((theta @ self.parts).reshape(self.scatter.squares.shape) + known)

    def log_likelihood(self, theta: Array) -> float:
        return float(self.scatter.log_likelihoods(self.covariance(theta)).sum())

    def normal(self, theta: Array) -> tuple[Array, Array]:
        """Expected information (c, c), and u (c,): the scoring step goes to ``θ`` with ``I θ = u``."""
        J, nu = self.scatter.columns, self.scatter.freedom
        inverse = np.linalg.inv(self.covariance(theta))
        W = inverse @ J
        between = np.swapaxes(J, -1, -2) @ W
        weighted = self.scatter.squares - (nu * self.fixed)[:, None, None] * np.eye(J.shape[1])
        information = self.member.T @ (np.tensordot(nu, between**2, axes=1) / 2) @ self.member
        if self.fitted:
            across = self.member.T @ (np.tensordot(nu, np.sum(W**2, axis=1), axes=1) / 2)
            information[-1], information[:, -1] = across, across
            information[-1, -1] = nu @ np.sum(inverse**2, axis=(1, 2)) / 2
        return information, np.asarray(self.parts @ (inverse @ weighted @ inverse).ravel() / 2)

    def maximise(self, theta: Array, held: int | None = None) -> tuple[Array, float]:
        """The likeliest variances, and their log-likelihood; the component ``held`` keeps its value."""
        value = self.log_likelihood(theta)
        free = np.arange(self.size) != (-1 if held is None else held)
        for _ in range(_STEPS):
            step = self._scoring(theta, free) - theta
            before, size = value, 1.0
            while size > 1e-6:
                tried = np.maximum(theta + size * step, 0.0)
                value = self.log_likelihood(tried)
                if value >= before:
                    theta = tried
                    break
                size /= 2
            value = max(value, before)
            if value - before <= (_SETTLED if held is None else _ROUGH):
                break
        return theta, value

    def _scoring(self, theta: Array, free: NDArray[np.bool_]) -> Array:
        """Where a step of Fisher scoring leads, all variances kept at zero or above."""
        from scipy.optimize import nnls

        information, u = self.normal(theta)
        if not free.any():
            return theta
        u = u[free] - information[np.ix_(free, ~free)] @ theta[~free]
        information = information[np.ix_(free, free)]
        scale = _scale(information)
        values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
        known = values > 1e-12 * max(values[-1], 1e-300)
        roots = np.sqrt(values[known])
        A, b = roots[:, None] * vectors[:, known].T, (vectors[:, known].T @ (u * scale)) / roots
        moved = theta.copy()
        moved[free] = nnls(A, b)[0] * scale
        return moved

    def errors(self, theta: Array) -> Array:
        """(c,) standard errors of the variances; infinite where the data do not tell them."""
        information = self.normal(theta)[0]
        scale = _scale(information)
        values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
        known = values > 1e-9 * max(values[-1], 1e-300)
        spread = np.sum(vectors[:, known] ** 2 / values[known], axis=1)
        lost = np.linalg.norm(vectors[:, ~known], axis=1) > _PART
        return np.where(lost | (np.diag(information) <= 0), np.inf, np.sqrt(spread) * scale)

    def interval(self, theta: Array, best: float, k: int, error: float) -> tuple[float, float]:
        """The 95 % interval of one variance: where the others, made likeliest, leave the likelihood high enough."""
        if not np.isfinite(error):
            return 0.0, np.inf
        if theta[k] > 0 and 2 * (theta[k] / error) ** 2 > _PLAIN:
            spread = np.exp(np.sqrt(_CHI2) * error / theta[k])
            return float(theta[k] / spread), float(theta[k] * spread)
        return self._end(theta, best, k, error, -1), self._end(theta, best, k, error, 1)

    def _end(self, theta: Array, best: float, k: int, error: float, side: int) -> float:
        """Where the profile of the likelihood falls by half the 95 % quantile of χ².

        The root of the fall is nearly linear in the variance: regula falsi, with the Illinois rule, is quick.
        """
        near = theta

        def beyond(value: float) -> float:
            nonlocal near
            start = near.copy()
            start[k] = value
            near, likelihood = self.maximise(start, held=k)
            return float(np.sqrt(max(2 * (best - likelihood), 0.0)) - np.sqrt(_CHI2))

        inside, low, step = float(theta[k]), -float(np.sqrt(_CHI2)), 2 * error
        while True:
            outside = max(inside + side * step, 0.0)
            high = beyond(outside)
            if high > 0:
                break
            if outside == 0:
                return 0.0
            inside, low, step = outside, high, 2 * step
        former, middle = None, outside
        for _ in range(_STEPS):
            middle = (inside * high - outside * low) / (high - low)
            found = beyond(middle)
            if abs(found) < _NEAR:
                break
            kept = found > 0
            if kept == former:  # twice on one side: the other end weighs half
                low, high = (low / 2, high) if kept else (low, high / 2)
            former = kept
            if kept:
                outside, high = middle, found
            else:
                inside, low = middle, found
        return float(middle)


def _mean_square(scatter: Scatter) -> float:
    total = float(np.trace(scatter.squares, axis1=-2, axis2=-1).sum())
    return max(total / float(scatter.freedom.sum() * scatter.squares.shape[1]), 1e-300)


def _scale(information: Array) -> Array:
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    return np.divide(1.0, size, out=np.ones_like(size), where=size > 0)
