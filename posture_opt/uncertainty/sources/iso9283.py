"""ISO 9283 accuracy AP and repeatability RP, from samples and predicted from a covariance.

``RP = mean(l) + 3 S_l`` with ``l_j`` the distance of attained position j from the mean of them. RP is a single number
and sees neither direction nor shape: shrinking the lesser axis of an ellipse a hundredfold lowers it by a fifth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from posture_opt.errors import InputError, InsufficientDataError
from posture_opt.numerics import TURN, Array
from posture_opt.uncertainty.regions.regions import hotelling_factor

Interval = tuple[float, float]


@dataclass(frozen=True)
class PositionPerformance:
    """AP and RP of one commanded position, each with the interval in which sampling leaves the true value.

    Args:
        n: number of cycles (30 in the standard).
        accuracy: AP, distance of the mean attained position from the commanded one [m].
        accuracy_interval: from AP -+ t s / sqrt(n), s the deviation along the error, and from zero where Hotelling's
            test does not separate the mean from the commanded position [m].
        repeatability: RP = mean(l) + 3 S_l [m].
        repeatability_interval: for Gaussian scatter of the sample's shape, by simulating the test itself [m].
        mean_distance: mean(l) [m].
        sd_distance: S_l, with n - 1 [m].
        probability: that of the intervals.
    """

    n: int
    accuracy: float
    accuracy_interval: Interval
    repeatability: float
    repeatability_interval: Interval
    mean_distance: float
    sd_distance: float
    probability: float


@dataclass(frozen=True)
class OrientationPerformance:
    """AP and RP of one angle: ``AP = mean(a) - a_c`` and the half width ``RP = 3 S_a`` [rad], from n cycles."""

    n: int
    accuracy: float
    repeatability: float


@dataclass(frozen=True)
class RepeatabilitySampling:
    """How RP of n cycles scatters about the RP of infinitely many, as ratios of the two.

    Args:
        bias: mean of the ratio, minus one; below zero, as the mean position is fitted to the same cycles.
        sd: standard deviation of the ratio.
        interval: quantiles (1 - p) / 2 and (1 + p) / 2 of the ratio.
    """

    bias: float
    sd: float
    interval: Interval


def position_performance(
    attained: ArrayLike, commanded: ArrayLike, p: float = 0.95, seed: int | None = None
) -> PositionPerformance:
    """AP and RP of positions attained for one commanded position.

    ``AP = |mean(x) - x_c|``, ``l_j = |x_j - mean(x)|``, ``RP = mean(l) + 3 S_l``, ``S_l`` with n - 1.

    Args:
        attained: (n, d) [m], d = 1, 2 or 3.
        commanded: (d,) [m].
        p: probability of the intervals.
        seed: of the simulation behind the interval of RP.

    Raises:
        InputError: shapes that do not fit, or a number that is not finite.
        InsufficientDataError: fewer than three cycles.

    Source: ISO 9283:1998, 7.2.1 and 7.2.2.
    """
    accuracy, interval = position_accuracy(attained, commanded, p)
    x = _checked_cycles(attained)
    n, distance = len(x), np.linalg.norm(x - x.mean(axis=0), axis=1)
    mean, sd = float(distance.mean()), float(distance.std(ddof=1))
    covariance, repeatability = np.atleast_2d(np.cov(x, rowvar=False)), mean + 3 * sd
    low, high = repeatability_sampling(covariance, n, p, seed=seed).interval if repeatability else (1.0, 1.0)
    return PositionPerformance(
        n=n,
        accuracy=accuracy,
        accuracy_interval=interval,
        repeatability=repeatability,
        repeatability_interval=(repeatability / high, repeatability / low),
        mean_distance=mean,
        sd_distance=sd,
        probability=p,
    )


def position_accuracy(attained: ArrayLike, commanded: ArrayLike, p: float = 0.95) -> tuple[float, Interval]:
    """AP and its interval alone, without the simulation behind that of RP; see `position_performance`."""
    x, goal = _checked_cycles(attained), np.atleast_1d(np.asarray(commanded, dtype=float))
    if x.shape[1] != len(goal) or not np.isfinite(goal).all():
        raise InputError(f"a commanded position of {len(goal)} numbers does not fit attained ones of {x.shape[1]}")
    error = x.mean(axis=0) - goal
    accuracy = float(np.linalg.norm(error))
    covariance = np.atleast_2d(np.cov(x, rowvar=False))
    half = _accuracy_margin(covariance, error, len(x), p)
    # The length of a mean is never zero, even where the true one is: what scatter alone may make of it starts at zero.
    low = 0.0 if _mere_scatter(covariance, error, len(x), p) else max(accuracy - half, 0.0)
    return accuracy, (low, accuracy + half)


def orientation_performance(attained: ArrayLike, commanded: float) -> OrientationPerformance:
    """AP and RP of one angle (roll, pitch or yaw) attained n times [rad]; ISO 9283:1998, 7.2.1 and 7.2.2.

    Raises:
        InputError, InsufficientDataError: as `position_performance`.
    """
    angles = _checked_cycles(np.asarray(attained, dtype=float).reshape(-1, 1))[:, 0]
    # Angles on both sides of pi are near to each other: count them from the commanded one.
    offset = np.mod(angles - commanded + math.pi, TURN) - math.pi
    return OrientationPerformance(len(offset), float(offset.mean()), 3 * float(offset.std(ddof=1)))


def repeatability_sampling(
    covariance: ArrayLike, n: int = 30, p: float = 0.95, trials: int = 4000, seed: int | None = None
) -> RepeatabilitySampling:
    """How far RP of n Gaussian cycles may lie from the RP of infinitely many, by simulating the test.

    Args:
        covariance: (d, d), only its shape matters.
        n: cycles of one test.
        trials: tests simulated; the ends of the interval are good to some ``2 / sqrt(trials)`` of its width.

    Raises:
        InputError: n < 3, or a covariance of zero.
    """
    C = _checked_covariance(covariance)
    if n < 3 or not np.trace(C) > 0:
        raise InputError("repeatability needs three cycles or more, and some scatter")
    values, axes = np.linalg.eigh(C)
    root = axes * np.sqrt(np.clip(values, 0, None))
    x = np.random.default_rng(seed or 0).standard_normal((trials, n, len(C))) @ root.T
    distance = np.linalg.norm(x - x.mean(axis=1, keepdims=True), axis=2)
    found = distance.mean(axis=1) + 3 * distance.std(axis=1, ddof=1)
    ratio = found / repeatability_from_covariance(C)
    low, high = np.quantile(ratio, [(1 - p) / 2, (1 + p) / 2])
    return RepeatabilitySampling(float(ratio.mean() - 1), float(ratio.std(ddof=1)), (float(low), float(high)))


def repeatability_from_covariance(covariance: ArrayLike) -> float:
    """RP of a Gaussian point, ``E[l] + 3 sd[l]`` with ``l = |x - E x|`` [m].

    Args:
        covariance: (d, d) [m^2], d = 1, 2 or 3.

    Raises:
        InputError: not a square matrix of that size.

    Source: ISO 9283:1998, 7.2.2, for infinitely many cycles.

    Example:
        >>> import numpy as np
        >>> print(f"{repeatability_from_covariance(np.eye(3)):.5f}")
        3.61609
    """
    return float(repeatabilities(_checked_covariance(covariance)[None])[0])


def repeatabilities(covariances: ArrayLike) -> Array:
    """(N,) RP [m] of N Gaussian points with covariances (N, d, d) [m^2]; see `repeatability_from_covariance`."""
    mean, sd = distance_moments(covariances)
    return mean + 3 * sd


def distance_moments(covariances: ArrayLike) -> tuple[Array, Array]:
    """Mean and standard deviation, (N,) each, of the length of zero-mean Gaussian vectors [m].

    ``E l = 1 / (2 sqrt(pi)) Int_0^inf (1 - prod_i (1 + 2 t lambda_i)^(-1/2)) t^(-3/2) dt`` with the eigenvalues of
    C; equally ``2 sqrt(2/pi) R_G(lambda)``, Carlson's elliptic integral. ``sd^2 = tr C - (E l)^2``.

    Args:
        covariances: (N, d, d) [m^2], d = 1, 2 or 3, positive semidefinite.

    Raises:
        InputError: another shape, or a number that is not finite.

    Source: A. M. Mathai and S. B. Provost, Quadratic Forms in Random Variables (1992), 3.2b.
    """
    C = np.asarray(covariances, dtype=float)
    if C.ndim != 3 or C.shape[1] != C.shape[2] or not 1 <= C.shape[1] <= 3 or not np.isfinite(C).all():
        raise InputError(f"finite covariances (N, d, d) with d = 1, 2 or 3 are wanted, not {C.shape}")
    values = np.clip(np.linalg.eigvalsh((C + C.transpose(0, 2, 1)) / 2), 0, None)
    trace = values.sum(axis=1)
    shape = np.zeros((len(values), 3))
    shape[:, : values.shape[1]] = values / np.where(trace > 0, trace, 1.0)[:, None]
    a, b, c = shape.T
    mean = np.sqrt(trace) * _mean_length(a * b + b * c + c * a, a * b * c)
    return mean, np.sqrt(np.clip(trace - mean**2, 0, None))


def _mean_length(e2: Array, e3: Array) -> Array:
    """E l for eigenvalues of sum one, given the sum of their products by two and their product."""
    # On a line the integral is sqrt(2 / pi). What other shapes add to it decays on both sides of t = 1, and in s = ln t
    # the trapezoid rule of step 1/2 is exact to 1e-17: the integrand has no pole nearer to the real axis than i pi.
    s = np.arange(-30.0, 40.0, 0.5)
    t = np.exp(s)
    line = np.sqrt(1 + 2 * t)
    more = np.multiply.outer(e2, 4 * t**2) + np.multiply.outer(e3, 8 * t**3)
    shape = np.sqrt(1 + 2 * t + more)
    terms = more / (line * shape * (line + shape))  # 1 / line - 1 / shape, without cancellation
    result: Array = math.sqrt(2 / math.pi) + terms @ (0.5 * np.exp(-s / 2)) / (2 * math.sqrt(math.pi))
    return result


def _accuracy_margin(covariance: Array, error: Array, n: int, p: float) -> float:
    """Half width [m] of the interval of AP: ``t_((1+p)/2)(n - 1) s / sqrt(n)``, s the deviation along the error."""
    from scipy.special import stdtrit

    size = np.linalg.norm(error)
    # Without an error there is no direction to look along: take the worst one.
    variance = error @ covariance @ error / size**2 if size > 0 else np.linalg.eigvalsh(covariance)[-1]
    return float(stdtrit(n - 1, (1 + p) / 2)) * math.sqrt(variance / n)


def _mere_scatter(covariance: Array, error: Array, n: int, p: float) -> bool:
    """Whether Hotelling's test of size 1 - p does not reject a mean of zero."""
    d = len(error)
    if n <= d or np.linalg.matrix_rank(covariance, hermitian=True) < d:
        return False
    return float(n * error @ np.linalg.solve(covariance, error)) <= hotelling_factor(p, d, n - 1) ** 2


def _checked_cycles(attained: ArrayLike) -> Array:
    """(n, d) attained positions as floats.

    Raises:
        InputError: another shape, or a number that is not finite.
        InsufficientDataError: fewer than three cycles.
    """
    x = np.asarray(attained, dtype=float)
    if x.ndim != 2 or not 1 <= x.shape[1] <= 3 or not np.isfinite(x).all():
        raise InputError(f"finite attained positions (n, 3) are wanted, not {x.shape}")
    if len(x) < 3:
        raise InsufficientDataError(f"repeatability needs three cycles or more, 30 by ISO 9283; there are {len(x)}")
    return x


def _checked_covariance(covariance: ArrayLike) -> Array:
    """(d, d) a covariance as floats; a number is one on a line.

    Raises:
        InputError: not square.
    """
    C = np.atleast_2d(np.asarray(covariance, dtype=float))
    if C.ndim != 2 or C.shape[0] != C.shape[1]:
        raise InputError(f"a square covariance is wanted, not {C.shape}")
    return C
