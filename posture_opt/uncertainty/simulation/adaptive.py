"""Monte Carlo that stops by itself, and the sampling errors of what it finds.

Blocks of trials are drawn until the mean, the standard uncertainties, the correlations and the coverage factor have all
settled in the number of digits asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from posture_opt.errors import InputError
from posture_opt.numerics import Array
from posture_opt.uncertainty.regions.regions import Ellipsoid, coverage_factor

Draw = Callable[[int, np.random.Generator], Array]
"""``(M, generator) -> (M, m)`` trials of the output."""

MIN_BLOCKS = 10
"""Blocks at the least (JCGM 102:2011, 7.8.3)."""
SMALLEST_BLOCK = 10_000
"""Trials of a block at the least (JCGM 102:2011, 7.8.3)."""


@dataclass(frozen=True, eq=False)
class Digits:
    """One number for each quantity watched: the tolerances, or twice the standard errors reached.

    Args:
        mean: (m,) of the means.
        uncertainty: (m,) of the standard uncertainties.
        correlation: of the largest eigenvalue of the correlation matrix.
        coverage_factor: of kp.
    """

    mean: Array
    uncertainty: Array
    correlation: float
    coverage_factor: float

    def within(self, tolerances: Digits) -> bool:
        """Whether each number is at most its tolerance."""
        return bool(
            (self.mean <= tolerances.mean).all()
            and (self.uncertainty <= tolerances.uncertainty).all()
            and self.correlation <= tolerances.correlation
            and self.coverage_factor <= tolerances.coverage_factor
        )


@dataclass(frozen=True, eq=False)
class AdaptiveResult:
    """What the adaptive procedure found.

    Args:
        mean: (m,).
        covariance: (m, m), n - 1 in the denominator.
        n: number of trials, ``blocks`` times the size of a block.
        blocks: number of blocks.
        kp: coverage factor of the ellipsoid ``(y - mean)' C^-1 (y - mean) <= kp^2`` that holds p of the trials.
        kq: coverage factor of the box ``|y_j - mean_j| <= kq u_j`` that holds p of the trials.
        p: the probability of both.
        stable: False where ``max_blocks`` came first.
        tolerances: what had to be reached.
        reached: twice the standard error of each quantity.
        digits: significant ones that were asked for.
    """

    mean: Array
    covariance: Array
    n: int
    blocks: int
    kp: float
    kq: float
    p: float
    stable: bool
    tolerances: Digits
    reached: Digits
    digits: int

    @property
    def uncertainty(self) -> Array:
        """(m,) standard uncertainties, the roots of the diagonal of the covariance."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> Array:
        """(m, m) correlations; zero for a quantity that does not vary."""
        return correlation_matrix(self.covariance)

    def validates(self, mean: ArrayLike, covariance: ArrayLike) -> bool:
        """Whether a closed-form Gaussian result agrees with the trials in all digits asked for.

        Mean, u, largest eigenvalue of the correlations and kp differ by no more than the tolerances.

        Source: JCGM 102:2011, 8.1.
        """
        y, C = np.asarray(mean, dtype=float), np.asarray(covariance, dtype=float)
        kp = coverage_factor(self.p, max(Ellipsoid(y, C).rank, 1))
        difference = Digits(
            np.abs(y - self.mean),
            np.abs(np.sqrt(np.diag(C)) - self.uncertainty),
            abs(_largest_eigenvalue(correlation_matrix(C)) - _largest_eigenvalue(self.correlation)),
            abs(kp - self.kp),
        )
        return difference.within(self.tolerances)


def adaptive(
    draw: Draw, p: float = 0.95, digits: int = 2, seed: int | None = None, max_blocks: int = 200
) -> AdaptiveResult:
    """Draw blocks of trials until the results are stable in ``digits`` significant decimal digits.

    Blocks of ``M = max(ceil(100 / (1 - p)), 10^4)`` trials, at least ten. Stable is what has twice the standard error
    of the mean over blocks, ``2 s / sqrt(h)``, of every mean, every u, lambda_max(R) and kp, at or below
    `numerical_tolerance` of that u (for the means too), of lambda_max and of kp.

    Args:
        draw: gives (M, m) trials of the output for a number M and a generator.
        p: coverage probability of kp.
        digits: 1 or 2 are usual; each further one takes a hundred times the trials.
        seed: of the generator: the same seed gives the same result; 0 by default.
        max_blocks: bounds time and memory; reached, the result says ``stable=False``.

    Raises:
        InputError: p outside (0, 1), fewer than one digit or ten blocks, or trials that are not finite (M, m).

    Source: JCGM 102:2011, 7.8; for one quantity JCGM 101:2008, 7.9.
    """
    if not 0 < p < 1 or digits < 1 or max_blocks < MIN_BLOCKS:
        raise InputError(f"0 < p < 1, one digit and {MIN_BLOCKS} blocks at least: not {p:g}, {digits}, {max_blocks}")
    size = max(math.ceil(100 / (1 - p)), SMALLEST_BLOCK)
    rng = np.random.default_rng(seed or 0)
    trials: list[Array] = []
    summaries: list[Array] = []
    while True:
        trials.append(_checked_trials(draw(size, rng), size))
        summaries.append(_block_summary(trials[-1], p))
        if len(trials) >= MIN_BLOCKS:
            reached, tolerances = _reached_digits(np.array(summaries), digits)
            stable = reached.within(tolerances)
            if stable or len(trials) == max_blocks:
                break
    y = np.concatenate(trials)
    mean, covariance = y.mean(axis=0), np.atleast_2d(np.cov(y, rowvar=False))
    kp, kq = coverage_factors(y, p)
    return AdaptiveResult(mean, covariance, len(y), len(trials), kp, kq, p, stable, tolerances, reached, digits)


def coverage_factors(samples: ArrayLike, p: float = 0.95) -> tuple[float, float]:
    """kp of the ellipsoid and kq of the box, about the sample mean, that hold the part p of samples (N, m).

    The p-quantiles of ``sqrt((y - mean)' C^-1 (y - mean))`` and of ``max_j |y_j - mean_j| / u_j``: unlike the factors
    of a Gaussian they are right for any distribution. JCGM 102:2011, 7.7.
    """
    y = np.asarray(samples, dtype=float)
    mean, covariance = y.mean(axis=0), np.atleast_2d(np.cov(y, rowvar=False))
    u = np.sqrt(np.diag(covariance))
    outward = np.divide(np.abs(y - mean), u, out=np.zeros_like(y), where=u > 0).max(axis=1)
    # About the mean, so that a micrometre on a metre keeps its digits.
    distance = Ellipsoid(np.zeros_like(mean), covariance).mahalanobis(y - mean)
    return float(np.quantile(distance, p)), float(np.quantile(outward, p))


def numerical_tolerance(value: float, digits: int) -> float:
    """Half a unit of the last of ``digits`` significant decimal digits, ``10^l / 2`` with ``value = c 10^l``.

    c is a whole number of that many digits; zero has no digits, and its tolerance is zero. JCGM 101:2008, 7.9.2.

    Example:
        >>> numerical_tolerance(0.0996, 2)
        0.005
    """
    if value == 0:
        return 0.0
    # Through the decimal rounding itself: 0.0996 is 0.10 in two digits, whose last one is worth 0.01.
    exponent = int(f"{abs(value):.{digits - 1}e}".partition("e")[2])
    return 10.0 ** (exponent - digits + 1) / 2


def covariance_standard_error(covariance: ArrayLike, n: int) -> Array:
    """(m, m) standard error of a covariance (m, m) of n Gaussian samples: ``sqrt((C_ii C_jj + C_ij^2) / (n - 1))``.

    For a variance this is ``C_ii sqrt(2 / (n - 1))``. T. W. Anderson, An Introduction to Multivariate Statistical
    Analysis (2003), 3.4.

    Raises:
        InputError: n < 2.
    """
    if n < 2:
        raise InputError(f"a sample covariance needs two samples or more, not {n}")
    C = np.asarray(covariance, dtype=float)
    return np.asarray(np.sqrt((np.outer(np.diag(C), np.diag(C)) + C**2) / (n - 1)))


def sample_covariance_standard_error(samples: ArrayLike) -> Array:
    """(m, m) standard error of the covariance of samples (N, m) of any distribution, from their fourth moments.

    ``sqrt((mean(z_i^2 z_j^2) - C_ij^2) / N)`` with z the centred samples; it leaves out terms of relative order 1/N.
    """
    y = np.asarray(samples, dtype=float)
    z = y - y.mean(axis=0)
    C, fourth = z.T @ z / len(z), (z**2).T @ z**2 / len(z)
    return np.asarray(np.sqrt(np.clip(fourth - C**2, 0, None) / len(z)))


def correlation_matrix(covariance: ArrayLike) -> Array:
    """(m, m) correlations of a covariance (m, m); zero for a quantity that does not vary.

    Example:
        >>> correlation_matrix([[4.0, 1.0], [1.0, 1.0]]).tolist()
        [[1.0, 0.5], [0.5, 1.0]]
    """
    C = np.asarray(covariance, dtype=float)
    u = np.sqrt(np.diag(C))
    scale = np.outer(u, u)
    R: Array = np.divide(C, scale, out=np.zeros_like(C), where=scale > 0)
    np.fill_diagonal(R, 1.0)
    return R


def _block_summary(y: Array, p: float) -> Array:
    """(2 m + 2,) means, standard uncertainties, largest eigenvalue of the correlations and kp of one block."""
    covariance = np.atleast_2d(np.cov(y, rowvar=False))
    largest = _largest_eigenvalue(correlation_matrix(covariance))
    return np.concatenate([y.mean(axis=0), np.sqrt(np.diag(covariance)), [largest, coverage_factors(y, p)[0]]])


def _reached_digits(summaries: Array, digits: int) -> tuple[Digits, Digits]:
    """Twice the standard errors of the means over blocks (h, 2 m + 2), and what they have to reach."""
    m = (summaries.shape[1] - 2) // 2
    average = summaries.mean(axis=0)
    error = 2 * summaries.std(axis=0, ddof=1) / math.sqrt(len(summaries))
    delta = np.array([numerical_tolerance(float(value), digits) for value in average[m:]])
    reached = Digits(error[:m], error[m : 2 * m], float(error[-2]), float(error[-1]))
    return reached, Digits(delta[:m], delta[:m], float(delta[-2]), float(delta[-1]))


def _largest_eigenvalue(matrix: Array) -> float:
    """The largest eigenvalue of a symmetric matrix (m, m)."""
    return float(np.linalg.eigvalsh(matrix)[-1])


def _checked_trials(y: Array, size: int) -> Array:
    """The trials (size, m) as floats.

    Raises:
        InputError: another shape, or numbers that are not finite.
    """
    y = np.asarray(y, dtype=float)
    if y.ndim != 2 or len(y) != size or not np.isfinite(y).all():
        raise InputError(f"{size} finite trials (M, m) were asked for; {y.shape} came")
    return y
