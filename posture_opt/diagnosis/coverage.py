"""How much of what was measured lies in the regions that a model predicts, and by what factor these are off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from posture_opt.uncertainty.regions import coverage_factor

Array = NDArray[np.float64]
Codes = NDArray[np.intp]
Verdict = Literal["right", "understated", "overstated"]

P = 0.95
_DRAWS = 1000  # of the bootstrap over poses
_TAIL = 60  # poses: with fewer, the 95 % quantile of the distances hangs on one or two of them
LEVELS = (*(k / 20 for k in range(1, 20)), 0.99)


@dataclass(frozen=True, eq=False)
class Coverage:
    """Measured errors against the regions predicted for them.

    Args:
        share: of the rows inside the predicted 95 % region; ``interval`` holds it with 95 % confidence, poses being
            what is drawn at random.
        factor: by how much the spread must grow for the region to hold 95 %; ``factor_interval`` as above.
        by: how the factor was found: ``quantile`` of the distances, or ``likelihood`` of a common factor where
            there are too few poses for that.
        probability: (N,) ascending, of the smallest predicted region that holds each row: evenly spread over
            0 … 1 where the prediction is true.
        poses: how many of them; ``dimension`` of the region.
    """

    share: float
    interval: tuple[float, float]
    factor: float
    factor_interval: tuple[float, float]
    by: Literal["quantile", "likelihood"]
    probability: Array
    poses: int
    dimension: int

    @classmethod
    def of(cls, errors: Array, covariances: Array, groups: Codes) -> Coverage:
        """Of errors (N, d) [m] with predicted covariances (N, d, d) [m²]; rows of one group hang together.

        ``D_i² = e_iᵀ C_i⁻¹ e_i`` has the distribution χ²(d) where the prediction is true.
        """
        from scipy.special import chdtr

        squared, m = distances(errors, covariances), errors.shape[1]
        groups = np.unique(groups, return_inverse=True)[1]
        inside = squared <= coverage_factor(P, m) ** 2
        many = int(groups.max(initial=-1)) + 1
        by: Literal["quantile", "likelihood"] = "quantile" if many >= _TAIL else "likelihood"
        factor, ends = _factor(squared, m, groups, by)
        return cls(
            share=float(inside.mean()),
            interval=share_interval(inside, groups),
            factor=factor,
            factor_interval=ends,
            by=by,
            probability=np.sort(np.asarray(chdtr(m, squared))),
            poses=many,
            dimension=m,
        )

    @property
    def verdict(self) -> Verdict:
        """Whether the predicted spread is true, as far as the data tell."""
        low, high = self.factor_interval
        if low <= 1 <= high:
            return "right"
        return "understated" if self.factor > 1 else "overstated"

    def held(self, p: float) -> float:
        """The share of the rows in the predicted region of probability ``p``."""
        return float(np.searchsorted(self.probability, p, side="right") / len(self.probability))

    def to_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return {
            "rows": len(self.probability), "poses": self.poses, "share": self.share,
            "interval95": list(self.interval), "factor": self.factor,
            "factor_interval95": list(self.factor_interval), "factor_by": self.by, "verdict": self.verdict,
            "reliability": [[p, self.held(p)] for p in LEVELS],
        }  # fmt: skip


def distances(errors: Array, covariances: Array) -> Array:
    """(N,) squared Mahalanobis distances ``eᵀ C⁻¹ e`` of errors (N, d) with covariances (N, d, d)."""
    return np.asarray(np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[..., None])[..., 0]))


def share_interval(inside: NDArray[np.bool_], groups: Codes) -> tuple[float, float]:
    """The 95 % interval of a share of rows that hang together in groups.

    Clopper and Pearson's (1934) for as many independent rows as would vary as much as the groups do (Korn,
    Graubard 1998).
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


def _factor(
    squared: Array, m: int, groups: Codes, by: Literal["quantile", "likelihood"]
) -> tuple[float, tuple[float, float]]:
    if by == "likelihood":
        return common_factor(squared, m, groups)
    radius = coverage_factor(P, m)
    order = np.argsort(groups, kind="stable")
    parts = np.split(squared[order], np.flatnonzero(np.diff(groups[order])) + 1)
    rng = np.random.default_rng(0)
    drawn = np.empty(_DRAWS)
    alone = len(parts) == len(squared)
    for k in range(_DRAWS):
        chosen = rng.integers(len(parts), size=len(parts))
        sample = squared[chosen] if alone else np.concatenate([parts[i] for i in chosen])
        drawn[k] = np.quantile(sample, P)
    low, high = np.sqrt(np.quantile(drawn, [0.025, 0.975])) / radius
    return float(np.sqrt(np.quantile(squared, P))) / radius, (float(low), float(high))


def common_factor(squared: Array, m: int, groups: Codes) -> tuple[float, tuple[float, float]]:
    """The likeliest common factor of all predicted standard deviations, ``f² = mean(D²) / m``, and its interval.

    The freedom of the sum of D² is what its scatter over the groups leaves of ``m`` a row, and no more than that.
    """
    from scipy.special import chdtri

    count = np.bincount(groups)
    mean = float(squared.mean())
    off = np.bincount(groups, squared) - mean * count
    many = len(count)
    variance = float(np.sum(off**2)) / len(squared) ** 2 * many / max(many - 1, 1)
    freedom = min(2 * mean**2 / variance, m * len(squared)) if variance > 0 else float(m * len(squared))
    low, high = np.sqrt(mean / m * freedom / np.array([chdtri(freedom, 0.025), chdtri(freedom, 0.975)]))
    return float(np.sqrt(mean / m)), (float(low), float(high))
