"""How much of what was measured lies in the regions that a model predicts, and by what factor these are off.

With the predicted covariance C (d, d) of an error e, ``D² = eᵀ C⁻¹ e`` is χ² with d degrees of freedom where the
prediction is true. A region of probability p holds the errors with ``D² ≤ χ²_d(p)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from posture_opt.numerics import Array, Codes, Json, Mask
from posture_opt.uncertainty.regions import coverage_factor
from posture_opt.validation.prediction import Prediction

Verdict = Literal["right", "understated", "overstated"]

REGION_PROBABILITY = 0.95
INTERVAL_QUANTILES = (0.025, 0.975)
RELIABILITY_LEVELS = (*(k / 20 for k in range(1, 20)), 0.99)
_FACTOR_TOLERANCE = 1.1  # a factor that no decision depends on
_COVERAGE_DRAWS = 400  # of the bootstrap over poses, and of data as predicted


@dataclass(frozen=True, eq=False)
class Coverage:
    """Measured errors against the regions predicted for them."""

    # of the rows inside the predicted 95 % region; ``interval`` holds it with 95 % confidence, poses being what is
    # drawn at random
    share: float
    interval: tuple[float, float]
    # 95 % of data sets that are as predicted have a share between these. What stays from repeat to repeat is one draw
    # for all rows of one robot, so that they may be wide
    expected: tuple[float, float]
    # by how much the predicted spread must grow for its region to hold 95 %; ``factor_interval`` holds it with 95 %
    # confidence, whether poses or data as predicted are drawn
    factor: float
    factor_interval: tuple[float, float]
    # (N,) ascending, of the smallest predicted region that holds each row: evenly spread over 0 … 1 where the
    # prediction is true
    probability: Array
    # (levels, 2) ends between which the share held at each of ``RELIABILITY_LEVELS`` is in 95 % of data as predicted
    band: Array
    poses: int  # how many of them; ``dimension`` of the regions
    dimension: int

    @classmethod
    def of(cls, errors: Array, predicted: Prediction, groups: Codes) -> Coverage:
        """Of errors (N, d) [m]; rows of one group (N,) are correlated.

        ``D_i² = e_iᵀ C_i⁻¹ e_i`` has the distribution χ²(d) where the prediction is true, and the factor is the root of
        its 95 % quantile over what data simulated as predicted have in the median. Its interval is that of such data,
        or that of a bootstrap over the groups, whichever reaches further.

        errors (N, d) of rows that the model has not seen [m]; groups (N,) codes; a bootstrap draws whole groups.
        """
        from scipy.special import chdtr

        squared, m = squared_distances(errors, predicted.covariance), errors.shape[1]
        groups = np.unique(groups, return_inverse=True)[1]
        reach, held = _as_predicted(predicted)
        shares = held[:, RELIABILITY_LEVELS.index(REGION_PROBABILITY)]
        found, typical = float(np.sqrt(np.quantile(squared, REGION_PROBABILITY))), float(np.median(reach))
        by_chance, drawn = found / np.quantile(reach, INTERVAL_QUANTILES), _bootstrap_radius(squared, groups) / typical
        ends = np.concatenate([by_chance, drawn])
        inside = squared <= coverage_factor(REGION_PROBABILITY, m) ** 2
        low, high = np.quantile(shares, INTERVAL_QUANTILES).tolist()
        return cls(
            share=float(inside.mean()),
            interval=share_interval(inside, groups),
            expected=(low, high),
            factor=found / typical,
            factor_interval=(float(ends.min()), float(ends.max())),
            probability=np.sort(np.asarray(chdtr(m, squared))),
            band=np.quantile(held, INTERVAL_QUANTILES, axis=0).T,
            poses=int(groups.max()) + 1,
            dimension=m,
        )

    @property
    def verdict(self) -> Verdict:
        """Whether the predicted spread is true, as far as the data show; a tenth more or less is no matter."""
        low, high = self.factor_interval
        if low <= 1 <= high or 1 / _FACTOR_TOLERANCE <= self.factor <= _FACTOR_TOLERANCE:
            return "right"
        return "understated" if self.factor > 1 else "overstated"

    @property
    def concentration(self) -> float:
        """By how much the share in the 50 % region exceeds 0.5, where a region of the right size has another shape."""
        excess = self.held(0.5) - 0.5
        # 0.05 of the rows: less bends a curve that nobody sees
        shown = self.verdict == "right" and abs(excess) >= max(0.05, 3 * math.sqrt(0.25 / self.poses))
        return excess if shown else 0.0

    def held(self, p: float) -> float:
        """The share of the rows in the predicted region of probability ``p``."""
        return float(np.searchsorted(self.probability, p, side="right") / len(self.probability))

    def to_json(self) -> dict[str, Json]:
        return {
            "rows": len(self.probability), "poses": self.poses, "share": self.share, "interval95": list(self.interval),
            "expected95": list(self.expected), "factor": self.factor, "factor_interval95": list(self.factor_interval),
            "verdict": self.verdict, "reliability": [[p, self.held(p)] for p in RELIABILITY_LEVELS],
        }  # fmt: skip


def squared_distances(errors: Array, covariances: Array) -> Array:
    """(N,) squared Mahalanobis distances ``eᵀ C⁻¹ e`` of errors (N, d) with covariances (N, d, d).

    errors: [m]; covariances: positive definite [m²].
    """
    return np.asarray(np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[..., None])[..., 0]))


def share_interval(inside: Mask, groups: Codes) -> tuple[float, float]:
    """The 95 % interval of a share of rows that are correlated within groups.

    Clopper and Pearson's (1934) for as many independent rows as would vary as much as the groups do (Korn, Graubard
    1998): ``n_eff = p (1 − p) / v`` with the variance v of the share between groups, n at the most.

    inside (N,) whether each row counts; groups: (N,) codes from 0 on.
    """
    from scipy.special import betaincinv

    n, share = len(inside), float(inside.mean())
    count = np.bincount(groups)
    off = np.bincount(groups, inside) - share * count
    many = len(count)
    variance = float(np.sum(off**2)) / n**2 * many / max(many - 1, 1)
    effective = min(share * (1 - share) / variance, n) if variance > 0 else float(many)
    hit = share * effective
    low = float(betaincinv(hit, effective - hit + 1, 0.025)) if hit > 0 else 0.0
    high = float(betaincinv(hit + 1, effective - hit, 0.975)) if hit < effective else 1.0
    return low, high


def _as_predicted(predicted: Prediction) -> tuple[Array, Array]:
    """Data that are as predicted, drawn many times: one δ for all rows of a draw, a v for each row.

    Returns The radius (draws,) that holds `REGION_PROBABILITY` of the rows of each draw, and their share (draws,
    levels) in the region of each of `RELIABILITY_LEVELS`.
    """
    rng = np.random.default_rng(0)
    L = np.linalg.cholesky(predicted.covariance)
    common = np.linalg.solve(L, predicted.common)
    scatter = np.linalg.solve(L, np.linalg.cholesky(predicted.scatter))
    n, d, k = common.shape
    limits = np.array([coverage_factor(p, d) ** 2 for p in RELIABILITY_LEVELS])
    reach, held = np.empty(_COVERAGE_DRAWS), np.empty((_COVERAGE_DRAWS, len(limits)))
    # 1_000_000 numbers at a time
    step = max(1_000_000 // (n * d), 1)
    for first in range(0, _COVERAGE_DRAWS, step):
        some = slice(first, min(first + step, _COVERAGE_DRAWS))
        many = some.stop - first
        e = common @ rng.standard_normal((k, many)) + scatter @ rng.standard_normal((n, d, many))
        squared = np.sort(np.einsum("nib,nib->bn", e, e), axis=1)
        reach[some] = np.sqrt(np.quantile(squared, REGION_PROBABILITY, axis=1))
        held[some] = [np.searchsorted(row, limits, side="right") / n for row in squared]
    return reach, held


def _bootstrap_radius(squared: Array, groups: Codes) -> Array:
    """(2,) the 95 % interval of the root of the 95 % quantile, groups drawn with replacement."""
    order = np.argsort(squared)
    many = int(groups.max()) + 1
    rng = np.random.default_rng(0)
    drawn = np.empty(_COVERAGE_DRAWS)
    for k in range(_COVERAGE_DRAWS):
        weight = np.cumsum(np.bincount(rng.integers(many, size=many), minlength=many)[groups[order]])
        drawn[k] = squared[order[np.searchsorted(weight, REGION_PROBABILITY * weight[-1])]]
    return np.asarray(np.sqrt(np.quantile(drawn, INTERVAL_QUANTILES)))
