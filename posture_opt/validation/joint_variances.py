"""Scatter of the joints from the scatter of the tool point: variance components by (restricted) likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.errors import InsufficientDataError
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.uncertainty.regions import NORMAL95
from posture_opt.validation.scatter_model import Scatter, joint_covariances

_MAX_SCORING_STEPS = 200  # of Fisher scoring; five to twenty suffice


@dataclass(frozen=True, eq=False)
class Components:
    """Variances θ (c,) and the covariance ``known + Σ θ_c M_c`` that is linear in them."""

    scatter: Scatter  # sums of squares with their degrees of freedom
    member: Array  # (n, c) which component each joint's variance is; the instrument's is the last where it is fitted
    # variance of the instrument that is taken as known [m²], or the floor that its component is counted from
    fixed: float
    fitted: bool  # whether the instrument's variance is a component

    @classmethod
    def of(cls, scatter: Scatter, names: tuple[str, ...], instrument: float, fitted: bool, equal: bool) -> Components:
        """One component a joint, or one for all turning joints if ``equal``; the instrument's if ``fitted``."""
        alike = np.array([equal and not name.endswith(".d") for name in names])
        member = np.eye(len(names))
        if alike.any():
            common = alike.astype(float)[:, None]
            member = np.concatenate([common, member[:, ~alike]], axis=1)
        member = np.concatenate([member, np.zeros((len(names), int(fitted)))], axis=1)
        # 1e-6 of the RMS error: an instrument of exactly no noise would make singular covariances
        floor = 1e-6**2 * _mean_square(scatter)
        return cls(scatter, member, max(0.0 if fitted else instrument**2, floor), fitted)

    @property
    def size(self) -> int:
        """The number c of components."""
        return int(self.member.shape[1])

    def start(self) -> Array:
        """Every component as large as would explain its part of all scatter."""
        levers = np.einsum("gdn,gdn->n", self.scatter.columns, self.scatter.columns) @ self.member
        levers /= len(self.scatter.columns) * self.scatter.squares.shape[1]
        if self.fitted:
            levers[-1] = 1.0
        # 1e-9 of the longest lever: a joint that moves nothing
        moving, total = levers > 1e-9**2 * levers.max(initial=0.0), _mean_square(self.scatter)
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
        """The likeliest variances, and their log-likelihood; the component ``held`` keeps its value."""
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
            # 1e-8 of log-likelihood: what a further step would gain
            # 1e-3 the same where an interval of 95 % is sought
            if value - before <= (1e-8 if held is None else 1e-3):
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
        """(c,) standard errors of the variances; infinite where the data do not determine them."""
        information = self.normal(theta)[0]
        scale = _unit_diagonal(information)
        values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
        known = values > 1e-9 * max(values[-1], 1e-300)
        spread = np.sum(vectors[:, known] ** 2 / values[known], axis=1)
        # 0.05 of an undetermined direction: a smaller part does not spoil a component
        lost = np.linalg.norm(vectors[:, ~known], axis=1) > 0.05
        return np.where(lost | (np.diag(information) <= 0), np.inf, np.sqrt(spread) * scale)

    def interval(self, theta: Array, best: float, k: int, error: float) -> tuple[float, float]:
        """The 95 % interval of one variance: where the others, made likeliest, leave the likelihood high enough."""
        if not np.isfinite(error):
            return 0.0, np.inf
        # 200 degrees of freedom: from there on the likelihood is quadratic in log σ
        if theta[k] > 0 and 2 * (theta[k] / error) ** 2 > 200.0:
            spread = np.exp(NORMAL95 * error / theta[k])
            return float(theta[k] / spread), float(theta[k] * spread)
        return self._interval_end(theta, best, k, error, -1), self._interval_end(theta, best, k, error, 1)

    def _interval_end(self, theta: Array, best: float, k: int, error: float, side: int) -> float:
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
        # 0.03 of the root of χ²: how exactly the end of an interval is found
        if abs(found) < 0.03:
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
    # 1e-12 m: less is rounding
    return max(total / float(scatter.freedom.sum() * scatter.squares.shape[1]), 1e-12**2)


def _unit_diagonal(information: Array) -> Array:
    """Factors (c,) that make the diagonal of an information matrix one; 1 where it is zero."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    return np.divide(1.0, size, out=np.ones_like(size), where=size > 0)


@dataclass(frozen=True, eq=False)
class JointVariances:
    """Standard deviations of the joints and of the instrument."""

    names: tuple[str, ...]  # (n,) the joints' errors, ``JOINT.theta`` or ``JOINT.d``
    sigma: Array  # (n,) standard deviations [rad, m], 0 or more
    # (n,) standard errors of ``sigma``; of a σ of 0, by how much it may be more; infinite where the data do not
    # determine it
    std: Array
    interval: Array  # (n, 2) 95 % intervals of ``sigma`` by the profile likelihood
    # instrument, instrument_std: the instrument's standard deviation of a coordinate [m], error 0 where it was given;
    # ``instrument_interval`` as above
    instrument: float
    instrument_std: float
    instrument_interval: tuple[float, float]
    log_likelihood: float  # at the maximum; of the contrasts within groups where there are groups

    def covariance(self, columns: Array) -> Array:
        """``s² I + J diag(σ²) Jᵀ`` (N, d, d) [m²] at the postures of ``columns`` (N, d, n) [m/rad, m/m]."""
        return joint_covariances(columns, self.sigma, self.instrument)

    @property
    def determined(self) -> Mask:
        """(n,) whether the data determine each σ."""
        return np.isfinite(self.std)


def estimate_joint_variances(
    errors: Array,
    columns: Array,
    *,
    groups: Codes | None = None,
    instrument: float,
    fit_instrument: bool = False,
    equal: bool = False,
    names: Sequence[str] = (),
    known: Array | None = None,
) -> JointVariances:
    """Standard deviations of the joints that make measured errors likeliest.

    ``error ~ N(μ_group or 0, s² I + J diag(σ²) Jᵀ)`` with ``σ ≥ 0``. The restricted likelihood (Patterson, Thompson
    1971) of the contrasts within groups does not know the group means. Fisher scoring on the variances, each step a
    non-negative least squares problem: the covariance is linear in them, so that the step to ``θ = I(θ)⁻¹ u(θ)`` is the
    Newton step with the expected information (Searle, Casella, McCulloch 1992, 6.6).

    errors (N, d) [m], d = 1, 2 or 3; columns (N, d, n) shift of the tool point by a unit of each joint's error [m/rad,
    m/m]; groups (N,) rows of one code repeat one posture; ``None`` takes the errors to be about zero; instrument:
    standard deviation s of a measured coordinate [m]; a start where ``fit_instrument``; names (n,) the joints' errors;
    known (N, d, d) covariance of the errors besides [m²], as that of a prediction; not with ``groups``.
    """
    named = tuple(names) or tuple(f"joint{i + 1}.theta" for i in range(columns.shape[2]))
    scatter = Scatter.of(np.asarray(errors, dtype=float), np.asarray(columns, dtype=float), groups, known)
    if not len(scatter.freedom):
        raise InsufficientDataError("no posture was measured twice: repeat some postures to see their scatter")
    return fit_joint_variances(scatter, named, instrument, fit_instrument, equal)


def fit_joint_variances(
    scatter: Scatter,
    names: tuple[str, ...],
    instrument: float,
    fit_instrument: bool = False,
    equal: bool = False,
    intervals: bool = True,
) -> JointVariances:
    """As :func:`estimate_joint_variances`, from sums of squares; ``intervals`` are left open where not asked for.

    scatter: sums of squares (G, d, d) [m²] with their degrees of freedom and joint columns.
    """
    model = Components.of(scatter, names, instrument, fit_instrument, equal)
    freedom = int(scatter.freedom.sum()) * scatter.squares.shape[1]
    if freedom < model.size:
        need = int(np.ceil(model.size / scatter.squares.shape[1]))
        raise InsufficientDataError(
            f"{freedom} coordinates of scatter cannot determine {model.size} standard deviations: measure at least "
            f"{need} more repeats, at different postures"
        )
    theta, best = model.maximise(model.start())
    if not np.isfinite(best):
        raise InsufficientDataError("errors of such different sizes do not determine the scatter of the joints")
    error = model.errors(theta)
    search = range(model.size) if intervals else ()
    ends = np.array([model.interval(theta, best, k, error[k]) for k in search] or [(0.0, np.inf)] * model.size)
    joints = model.member.argmax(axis=1)
    finite = np.where(np.isfinite(error), error, 0.0)
    # std(√θ) = std(θ) / (2 √θ); near zero, where a tangent says nothing, √θ is half the root of the error at the least.
    steep = 2 * np.maximum(np.sqrt(theta), np.sqrt(finite) / 2)
    std = np.divide(finite, steep, out=np.zeros_like(finite), where=steep > 0)
    sigma, std = np.sqrt(theta), np.where(np.isfinite(error), std, np.inf)
    last = model.size - 1
    own, own_std = model.fixed**0.5, 0.0
    low = high = own
    if fit_instrument:
        own, own_std = float(np.sqrt(theta[last] + model.fixed)), float(std[last])
        low, high = np.sqrt(ends[last] + model.fixed).tolist()
    return JointVariances(
        names=names,
        sigma=sigma[joints],
        std=std[joints],
        interval=np.sqrt(ends)[joints],
        instrument=own,
        instrument_std=own_std,
        instrument_interval=(low, high),
        log_likelihood=best,
    )


def likeliest_variances(
    errors: Array, known: Array, columns: Array, names: tuple[str, ...], instrument: float, *, fit: bool
) -> JointVariances | None:
    """One σ for all turning joints, unless the likelihood speaks clearly for one each (Schwarz 1978).

    errors (N, d) about zero [m]; ``known`` (N, d, d) part of their covariance [m²]; columns (N, d, n) shift of the tool
    point by a unit of each joint's error [m/rad, m/m]; instrument: σ of a coordinate [m]; a start where ``fit``.
    """

    def estimated(names: Sequence[str], columns: Array, known: Array, equal: bool) -> JointVariances | None:
        try:
            return estimate_joint_variances(
                errors, columns, instrument=instrument, fit_instrument=fit, equal=equal, names=names, known=known
            )
        except InsufficientDataError:
            return None

    common = estimated(names, columns, known, True)
    if common is None or not common.determined.all():
        return None
    # The last joint of an arm turns the tool point a little about itself: asked alone, it would have to swing by
    # degrees to explain what others leave. With a lever below 0.1 of the longest, it has no σ of its own.
    lever = np.sqrt(np.mean(np.sum(columns**2, axis=1), axis=0))
    turning = np.array([not name.endswith(".d") for name in names])
    strong = ~turning | (lever > 0.1 * lever[turning].max(initial=0.0))
    many = int(np.count_nonzero(turning & strong))
    if many < 2:
        return common
    weak = columns[:, :, ~strong] * common.sigma[~strong]
    own = [name for name, s in zip(names, strong, strict=True) if s]
    each = estimated(own, columns[:, :, strong], known + weak @ np.swapaxes(weak, -1, -2), False)
    if each is None or not each.determined.all():
        return common
    if not 2 * (each.log_likelihood - common.log_likelihood) > (many - 1) * math.log(errors.size):
        return common
    # Where the data allow no σ, half of the most that they allow: the root mean square of a half normal with that 95 %
    # end. A likeliest σ of zero would predict a region without thickness, and little data find one often.
    low, high = each.interval.T
    allowed = np.where((low <= 0) & np.isfinite(high), np.maximum(each.sigma, high / 2), each.sigma)
    sigma, std, interval = common.sigma.copy(), common.std.copy(), common.interval.copy()
    sigma[strong], std[strong], interval[strong] = allowed, each.std, each.interval
    return replace(each, names=names, sigma=sigma, std=std, interval=interval)
