"""Whether the first-order ellipse may be trusted: an index that sees the narrow axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from posture_opt.numerics import Array, finite_or_none
from posture_opt.uncertainty.regions import RANK_TOLERANCE

Verdict = Literal["good", "doubtful", "wrong"]

# Up to the first the nominal 95 % ellipse of planar arms held 94.5 % or more, up to the second 92 %, then ever less.
GOOD = 0.2
DOUBTFUL = 0.5

# A direction that the first order leaves at rest moves in truth if it takes this part of the second-order scatter;
# below it stands the rounding of the direction itself.
_MOVES = 1e-9


@dataclass(frozen=True)
class Validity:
    """How far curvature bends the first-order picture, in units of its own standard deviations.

    ``curvature = sqrt(lambda_max(C1^+ C2))`` with ``C1 = J S J'`` and ``C2_ab = 1/2 tr(H_a S H_b S)``;
    ``bias_mahalanobis = |C1^(-1/2) b|`` with ``b_a = 1/2 tr(H_a S)``. Both are infinite where C1 has an axis of no
    width along which C2 or b is not zero: there the linear number is false however small the errors are. The relative
    error of C1 itself does not see this: it is dominated by the wide axis, where nothing is wrong.
    """

    curvature: float
    bias_mahalanobis: float

    @classmethod
    def of(cls, first_order: ArrayLike, second_order: ArrayLike, bias: ArrayLike) -> Validity:
        """The indices at one posture.

        Args:
            first_order: (m, m) C1 [m^2].
            second_order: (m, m) C2 [m^2].
            bias: (m,) b [m].
        """
        C1, C2 = np.asarray(first_order, dtype=float), np.asarray(second_order, dtype=float)
        b = np.asarray(bias, dtype=float).reshape(-1)
        variances, axes = np.linalg.eigh((C1 + C1.T) / 2)
        wide = variances > RANK_TOLERANCE * max(variances[-1], 0.0)
        span, null = axes[:, wide] / np.sqrt(variances[wide]), axes[:, ~wide]
        curvature = math.sqrt(_largest(span.T @ C2 @ span))
        shift = float(np.linalg.norm(span.T @ b))
        if _largest(null.T @ C2 @ null) > _MOVES * np.trace(C2):
            curvature = math.inf
        if np.linalg.norm(null.T @ b) > math.sqrt(_MOVES) * np.linalg.norm(b):
            shift = math.inf
        return cls(curvature, shift)

    @property
    def index(self) -> float:
        """The larger of the two."""
        return max(self.curvature, self.bias_mahalanobis)

    @property
    def verdict(self) -> Verdict:
        """``good`` below 0.2, ``doubtful`` below 0.5, else ``wrong``."""
        return "good" if self.index < GOOD else "doubtful" if self.index < DOUBTFUL else "wrong"

    @property
    def text(self) -> str:
        """The verdict in a sentence."""
        if math.isinf(self.index):
            return (
                "The first-order ellipse is wrong here: it has no width in a direction in which the tool point does "
                "move, as in a singular posture. Use the exact covariance."
            )
        seen = f"(curvature index {self.curvature:.2g}, mean shift {self.bias_mahalanobis:.2g} standard deviations; "
        if self.verdict == "good":
            return (
                "The first-order ellipse can be trusted here: errors of this size move the tool point along nearly "
                f"straight lines {seen}both below {GOOD:g})."
            )
        if self.verdict == "doubtful":
            return (
                "The first-order ellipse is doubtful here: the errors bend its narrow axis, and its 95 % region holds "
                f"noticeably less. Use the exact covariance {seen}{GOOD:g} is the limit)."
            )
        return (
            "The first-order ellipse is wrong here: the errors bend its narrow axis, and its 95 % region holds far "
            f"less. Use the exact covariance {seen}{GOOD:g} is the limit)."
        )

    def to_json(self) -> dict[str, Any]:
        """Indices, null where infinite (then the flag beside is true), verdict and sentence."""
        return {
            "curvature": finite_or_none(self.curvature),
            "curvature_infinite": math.isinf(self.curvature),
            "bias_mahalanobis": finite_or_none(self.bias_mahalanobis),
            "bias_infinite": math.isinf(self.bias_mahalanobis),
            "verdict": self.verdict,
            "text": self.text,
        }


def _largest(matrix: Array) -> float:
    """The largest eigenvalue, zero at least; of nothing, zero."""
    return max(float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[-1]), 0.0) if matrix.size else 0.0
