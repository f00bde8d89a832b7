"""The covariance of parameters across a batch, from estimates that have errors of their own."""

# A random-effects model: robot r has the true deviations ``b_r ~ N(μ, Ω)`` and its calibration returns ``x_r = b_r +
# e_r`` with ``e_r ~ N(0, S_r)``. The spread of the estimates is ``Ω + S_r``; only Ω says how robots of the type
# differ. Few robots determine it: with R of them a standard deviation has a relative error of about ``1/√(2R)``.

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.numerics import Array, Json
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.regions import NORMAL95
from posture_opt.uncertainty.sources import Sources
from posture_opt.validation.model_errors import holm_rejections

_COVARIANCE_TOLERANCE = 1e-6  # of a scaled covariance


@dataclass(frozen=True, eq=False)
class BatchCovariance:
    """How k parameters vary from robot to robot.

    Units are mixed: [rad] for angles, [m] for lengths, products of the two in the covariance. All k parameters are in
    the order of the calibration that they came from.
    """

    # mean, mean_std: (k,) of the batch, with standard errors [rad, m]
    mean: Array
    mean_std: Array
    covariance: Array  # (k, k) between robots, positive semidefinite
    interval: Array  # (k, 2) 95 % intervals of the standard deviations
    correlation_interval: Array  # (k, k, 2) of the correlations
    p_correlation: Array  # (k, k) probability of a correlation so large, were the true one zero

    @property
    def sigma(self) -> Array:
        """(k,) standard deviations across the batch [rad, m]."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @property
    def correlation(self) -> Array:
        """(k, k) with ones on its diagonal; 0 where a parameter does not vary."""
        return correlation_matrix(self.covariance)


def correlation_matrix(covariance: Array) -> Array:
    """Correlations (k, k) of a covariance (k, k): ``C_ij / (σ_i σ_j)``, clipped to [−1, 1]."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size = np.outer(sigma, sigma)
    found = np.divide(covariance, size, out=np.zeros_like(covariance), where=size > 0)
    np.fill_diagonal(found, 1.0)
    return np.asarray(np.clip(found, -1.0, 1.0))


def covariance_between_robots(estimates: Array, errors: Array) -> BatchCovariance:
    """Covariance Ω between robots from estimates ``x_r ~ N(μ, Ω + S_r)``."""
    # Each round of EM takes the expectation of the true deviations b_r of every robot and re-estimates Ω from them:
    # ``Ω ← mean_r(û_r û_rᵀ + Ω − Ω P_r Ω)`` with ``û_r = Ω W_r (x_r − μ)``, ``W_r = (Ω + S_r)⁻¹`` and P_r the
    # projection that takes the estimate of μ off. Columns are scaled to unit size first, so that rad and m weigh the
    # same.
    # Ω maximises the restricted likelihood, by expectation and maximisation (Dempster, Laird, Rubin 1977; Laird, Ware
    # 1982), so that it stays positive semidefinite: the sample covariance less the mean of S_r need not be. Intervals
    # of standard deviations are those of the profile likelihood of one parameter at a time (Hardy, Thompson 1996);
    # those of correlations lie at ``tanh(artanh ρ ± 1.96 s)``, s from the information matrix and ``1 / √(R − 3)``
    # where the estimates have no errors (Fisher 1921).
    # estimates: (R, k) of R robots [rad, m]; errors: (R, k, k) covariances S_r of the estimates
    scale = np.maximum(estimates.std(axis=0, ddof=1), np.sqrt(np.diagonal(errors, axis1=1, axis2=2).mean(axis=0)))
    scale = np.where(scale > 0, scale, 1.0)
    x, S = estimates / scale, errors / np.outer(scale, scale)
    omega, mean, mean_covariance = _restricted_maximum(x, S)
    k = x.shape[1]
    ends = np.array([deviation_interval(x[:, i], S[:, i, i]) for i in range(k)]).reshape(-1, 2)
    rho_ends, p = _correlation_intervals(omega, S)
    return BatchCovariance(
        mean=mean * scale,
        mean_std=np.sqrt(np.diag(mean_covariance)) * scale,
        covariance=omega * np.outer(scale, scale),
        interval=ends * scale[:, None],
        correlation_interval=rho_ends,
        p_correlation=p,
    )


def _restricted_maximum(x: Array, S: Array) -> tuple[Array, Array, Array]:
    """Ω (k, k) of greatest restricted likelihood, the mean μ (k,), and the covariance (k, k) of μ."""
    # x: (R, k) estimates; S: (R, k, k) their covariances, both in scaled units
    omega = np.atleast_2d(np.cov(x, rowvar=False)) + 1e-6 * np.eye(x.shape[1])
    for _ in range(1000):  # a batch that varies less than its members are known to needs the most
        W = np.linalg.inv(omega + S)
        mean_covariance = np.linalg.inv(W.sum(axis=0))
        mean = mean_covariance @ np.einsum("rij,rj->i", W, x)
        u = np.einsum("ij,rjk,rk->ri", omega, W, x - mean)
        P = W - W @ mean_covariance @ W
        new = (u.T @ u) / len(x) + omega - omega @ P.mean(axis=0) @ omega
        moved = float(np.abs(new - omega).max())
        omega = (new + new.T) / 2
        if moved < _COVARIANCE_TOLERANCE:
            break
    return omega, mean, mean_covariance


def deviation_interval(x: Array, variances: Array) -> tuple[float, float]:
    """The 95 % interval of the standard deviation of true values behind estimates x (R,) with error variances (R,)."""
    # The ends are where twice the restricted profile log-likelihood falls by 3.84, the 95 % quantile of χ² with one
    # degree of freedom (Hardy, Thompson 1996). The lower end is 0 where no variation at all is that likely; the upper
    # one is infinite where the likelihood does not fall far enough on that side.
    from scipy.optimize import brentq, minimize_scalar

    def fall(log_sigma: float) -> float:
        return -_restricted_likelihood(math.exp(2 * log_sigma), x, variances)

    size = math.log(max(float(np.std(x, ddof=1)), 1e-12))
    low, high = size - 12, size + 6
    found = minimize_scalar(fall, bounds=(low, high), method="bounded", options={"xatol": 1e-6})
    none = -_restricted_likelihood(0.0, x, variances)
    best = min(float(found.fun), none)

    def beyond(log_sigma: float) -> float:
        return 2 * (fall(log_sigma) - best) - NORMAL95**2

    top = float(found.x) if found.fun <= none else low
    upper = math.exp(float(brentq(beyond, top, high + 20))) if beyond(high + 20) > 0 else math.inf
    if 2 * (none - best) <= NORMAL95**2 or beyond(low) <= 0:
        return 0.0, upper
    return math.exp(float(brentq(beyond, low, top))), upper


def _restricted_likelihood(variance: float, x: Array, variances: Array) -> float:
    # ``−½ (Σ ln V_r + ln Σ 1/V_r + Σ (x_r − μ̂)² / V_r)``, ``V_r = variance + variances_r``
    V = np.maximum(variance + variances, 1e-300)
    weight = float(np.sum(1 / V))
    mean = float(np.sum(x / V)) / weight
    return -0.5 * float(np.sum(np.log(V)) + math.log(weight) + np.sum((x - mean) ** 2 / V))


def _correlation_intervals(omega: Array, S: Array) -> tuple[Array, Array]:
    """Ends (k, k, 2) of 95 % intervals of all correlations, and their two-sided p-values (k, k), from Fisher's z."""
    from scipy.special import ndtr

    k = len(omega)
    ends, p = np.full((k, k, 2), 1.0), np.zeros((k, k))
    for i in range(k):
        for j in range(i):
            pair = [i, j]
            rho, error = _pair_correlation(omega[np.ix_(pair, pair)], S[:, pair][:, :, pair])
            z = math.atanh(rho)
            low, high = (math.tanh(z + side * NORMAL95 * error) for side in (-1, 1))
            ends[i, j] = ends[j, i] = low, high
            p[i, j] = p[j, i] = 2 * float(ndtr(-abs(z) / error)) if math.isfinite(error) else 1.0
    return ends, p


def _pair_correlation(omega: Array, S: Array) -> tuple[float, float]:
    # Three covariances need four robots: with fewer the standard error is infinite. The factor ``√(R / (R − 3))``
    # makes the result Fisher's ``1/√(R − 3)`` where the estimates have no errors.
    # omega: (2, 2) covariance between robots; S: (R, 2, 2) of the estimates' errors
    R = len(S)
    least = 1e-9 * max(float(np.trace(omega)), 1e-300)
    a, b, c = max(omega[0, 0], least), max(omega[1, 1], least), omega[0, 1]
    rho = float(np.clip(c / math.sqrt(a * b), -0.9999, 0.9999))
    if R < 4:
        return rho, math.inf
    parts = np.array([[[1.0, 0], [0, 0]], [[0, 0], [0, 1.0]], [[0, 1.0], [1.0, 0]]])
    V = np.array([[a, rho * math.sqrt(a * b)], [rho * math.sqrt(a * b), b]])
    W = np.linalg.inv(V + S)
    turned = np.einsum("rij,pjk->rpik", W, parts)
    information = np.einsum("rpik,rqki->pq", turned, turned) / 2
    inverse = np.linalg.pinv(information, rcond=1e-12)
    slope = np.array([-rho / (2 * a), -rho / (2 * b), 1 / math.sqrt(a * b)]) / (1 - rho**2)
    return rho, math.sqrt(max(float(slope @ inverse @ slope), 1e-300) * R / (R - 3))


@dataclass(frozen=True, eq=False)
class CorrelatedPair:
    """Two parameters that vary together, or may: the correlation, its 95 % interval, the stated one."""

    # a, b: names of the parameters, ``JOINT.PARAMETER``
    a: str
    b: str
    correlation: float
    interval: tuple[float, float]  # of the correlation
    p_value: float  # two-sided, were the true one zero
    stated: float  # the correlation that the problem file states; 0 where it states none
    significant: bool  # whether the correlation is kept by Holm's rule over all pairs, at 5 %

    def to_json(self) -> dict[str, Json]:
        return {
            "parameters": [self.a, self.b], "correlation": self.correlation, "interval95": list(self.interval),
            "p_value": self.p_value, "stated": self.stated, "significant": self.significant,
        }  # fmt: skip


def pairs_of(
    parameters: Sequence[Parameter], spread: BatchCovariance, problem: ProblemData
) -> tuple[CorrelatedPair, ...]:
    """Every pair of parameters, the most certain first."""
    # Which are significant, by Holm's (1979) rule over all of them
    # parameters: (k,) in the order of ``spread``
    names = [p.name for p in parameters]
    stated = {frozenset(pair): rho for pair, rho in stated_correlations(problem.sources).items()}
    k = len(names)
    indices = [(i, j) for i in range(k) for j in range(i + 1, k)]
    indices.sort(key=lambda ij: float(spread.p_correlation[ij]))
    p_values = [float(spread.p_correlation[ij]) for ij in indices]
    found = []
    for (i, j), p, significant in zip(indices, p_values, holm_rejections(p_values), strict=True):
        low, high = map(float, spread.correlation_interval[i, j])
        said = stated.get(frozenset((names[i], names[j])), 0.0)
        rho = float(spread.correlation[i, j])
        found.append(CorrelatedPair(names[i], names[j], rho, (low, high), p, said, significant))
    return tuple(found)


def stated_sigmas(parameters: Sequence[Parameter], problem: ProblemData) -> Array:
    """Standard deviations (k,) [rad or m] that the problem file states of parameters; 0 where it states nothing."""
    sources = problem.sources
    place = {name: i for i, name in enumerate(sources.names)}
    variances = np.diag(sources.constant)
    return np.array([np.sqrt(variances[place[p.name]]) if p.name in place else 0.0 for p in parameters])


def stated_correlations(sources: Sources) -> dict[tuple[str, str], float]:
    """Pairs of names of sources with a stated covariance -> their correlation; each pair once, in file order."""
    sigma = np.sqrt(np.diag(sources.constant))
    pairs = np.argwhere(np.triu(sources.constant, 1) != 0)
    return {
        (sources.names[i], sources.names[j]): float(sources.constant[i, j] / (sigma[i] * sigma[j])) for i, j in pairs
    }
