"""Monte Carlo that stops by itself, and coverage factors of what it finds.

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
from posture_opt.uncertainty.regions.regions import Ellipsoid

Draw = Callable[[int, np.random.Generator], Array]  # (M, generator) -> (M, m) trials of the output


@dataclass(frozen=True, eq=False)
class Digits:
    """One number for each quantity watched: the tolerances, or twice the standard errors reached."""

    mean: Array  # (m,) of the means
    uncertainty: Array  # (m,) of the standard uncertainties
    correlation: float  # of the largest eigenvalue of the correlation matrix
    coverage_factor: float  # of kp

    def within(self, tolerances: Digits) -> bool:
        """Whether each number is at most its tolerance."""
        return all(bool(np.all(value <= getattr(tolerances, name))) for name, value in vars(self).items())


@dataclass(frozen=True, eq=False)
class AdaptiveResult:
    """What the adaptive procedure found; ``stable`` is False where the most blocks came first."""

    mean: Array  # (m,)
    covariance: Array  # (m, m), n - 1 in the denominator
    n: int  # trials
    blocks: int
    kp: float  # of the ellipsoid (y - mean)' C^-1 (y - mean) <= kp^2 that holds p of the trials
    kq: float  # of the box |y_j - mean_j| <= kq u_j that holds p of the trials
    stable: bool
    tolerances: Digits
    reached: Digits
    digits: int  # significant ones that were asked for

    @property
    def uncertainty(self) -> Array:
        """(m,) standard uncertainties, the roots of the diagonal of the covariance."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> Array:
        return correlation_matrix(self.covariance)


def adaptive(
    draw: Draw, p: float = 0.95, digits: int = 2, seed: int | None = None, max_blocks: int = 200
) -> AdaptiveResult:
    """Draw blocks of trials until the results are stable in ``digits`` significant decimal digits.

    Blocks of ``M = max(ceil(100 / (1 - p)), 10^4)`` trials, at least ten. Stable is what has twice the standard error
    of the mean over blocks, ``2 s / sqrt(h)``, of every mean, every u, lambda_max(R) and kp, at or below the numerical
    tolerance of that u (for the means too), of lambda_max and of kp; each further digit takes a hundred times the
    trials. Source: JCGM 102:2011, 7.8; for one quantity JCGM 101:2008, 7.9.
    """
    least = 10
    if not 0 < p < 1 or digits < 1 or max_blocks < least:
        raise InputError(f"0 < p < 1, one digit and {least} blocks at least: not {p:g}, {digits}, {max_blocks}")
    size = max(math.ceil(100 / (1 - p)), 10_000)
    rng = np.random.default_rng(seed or 0)
    trials: list[Array] = []
    summaries: list[Array] = []
    while True:
        block = np.asarray(draw(size, rng), dtype=float)
        if block.ndim != 2 or len(block) != size or not np.isfinite(block).all():
            raise InputError(f"{size} finite trials (M, m) were asked for; {block.shape} came")
        trials.append(block)
        summaries.append(_block_summary(block, p))
        if len(trials) >= least:
            reached, tolerances = _reached_digits(np.array(summaries), digits)
            stable = reached.within(tolerances)
            if stable or len(trials) == max_blocks:
                break
    y = np.concatenate(trials)
    mean, covariance = y.mean(axis=0), np.atleast_2d(np.cov(y, rowvar=False))
    return AdaptiveResult(
        mean, covariance, len(y), len(trials), *coverage_factors(y, p), stable, tolerances, reached, digits
    )


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
    """Half a unit of the last of ``digits`` significant decimal digits; zero of zero. JCGM 101:2008, 7.9.2.

    ``10^l / 2`` with ``value = c 10^l``, c a whole number of that many digits.
    """
    if value == 0:
        return 0.0
    # Through the decimal rounding itself: 0.0996 is 0.10 in two digits, whose last one is worth 0.01.
    exponent = int(f"{abs(value):.{digits - 1}e}".partition("e")[2])
    return 10.0 ** (exponent - digits + 1) / 2


def correlation_matrix(covariance: ArrayLike) -> Array:
    """(m, m) correlations of a covariance (m, m); zero for a quantity that does not vary."""
    C = np.asarray(covariance, dtype=float)
    u = np.sqrt(np.diag(C))
    scale = np.outer(u, u)
    R: Array = np.divide(C, scale, out=np.zeros_like(C), where=scale > 0)
    np.fill_diagonal(R, 1.0)
    return R


def _block_summary(y: Array, p: float) -> Array:
    """(2 m + 2,) means, standard uncertainties, largest eigenvalue of the correlations and kp of one block."""
    covariance = np.atleast_2d(np.cov(y, rowvar=False))
    largest = float(np.linalg.eigvalsh(correlation_matrix(covariance))[-1])
    return np.concatenate([y.mean(axis=0), np.sqrt(np.diag(covariance)), [largest, coverage_factors(y, p)[0]]])


def _reached_digits(summaries: Array, digits: int) -> tuple[Digits, Digits]:
    """Twice the standard errors of the means over blocks (h, 2 m + 2), and what they have to reach."""
    m = (summaries.shape[1] - 2) // 2
    average = summaries.mean(axis=0)
    error = 2 * summaries.std(axis=0, ddof=1) / math.sqrt(len(summaries))
    delta = np.array([numerical_tolerance(float(value), digits) for value in average[m:]])
    reached = Digits(error[:m], error[m : 2 * m], float(error[-2]), float(error[-1]))
    return reached, Digits(delta[:m], delta[:m], float(delta[-2]), float(delta[-1]))
