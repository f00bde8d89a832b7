"""Whether the first-order ellipse may be trusted: curvature and bias of the tool point, complete to second order in σ.

``C1 = J Σ Jᵀ``, ``C2 = ½ tr(H_a Σ H_b Σ)`` and ``b = ½ tr(Σ H)`` (JCGM 100:2008, note to 5.1.2). Second derivatives
follow from the screws of the chain (:mod:`posture_opt.model.chain`): ``H_ij = a_i × J_j`` for i ≤ j.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from posture_opt.model.chain import Walk, position_column, rotation_column
from posture_opt.numerics import Array, Json, finite_or_none
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.regions.regions import RANK_TOLERANCE


class SecondOrder(NamedTuple):
    """The parts of the expansion, world frame."""

    first: Array  # (3, 3) J Σ Jᵀ [m²]
    curvature: Array  # (3, 3) ½ tr(H_a Σ H_b Σ) [m²]
    bias: Array  # (3,) ½ tr(Σ H) [m]


def second_order(walk: Walk, indices: Sequence[int], covariance: Array) -> SecondOrder:
    """The expansion at the pose of a walk in numbers; ``indices`` (k,) the factors of the sources, ascending."""
    k = len(indices)
    J = np.array([position_column(walk, i) for i in indices], dtype=float).reshape(k, 3)
    a = np.array([rotation_column(walk, i) for i in indices], dtype=float).reshape(k, 3)
    i, j = np.indices((k, k))
    H = np.cross(a[np.minimum(i, j)], J[np.maximum(i, j)])
    HS = np.einsum("ijc,jl->cil", H, covariance)
    curvature = np.einsum("cil,dli->cd", HS, HS) / 2
    return SecondOrder(J.T @ covariance @ J, curvature, np.einsum("ij,ijc->c", covariance, H) / 2)


Verdict = Literal["good", "doubtful", "wrong"]  # good: use either covariance; doubtful and wrong: use the exact one
_MAX_GOOD_INDEX = 0.2  # up to here the nominal 95 % ellipse of planar arms held 94.5 % or more; up to 0.5 92 %
# Share of the second-order scatter from which a direction that the first order leaves at rest moves in truth; below it
# is the rounding of the direction itself.
_MOTION_SHARE = 1e-9


@dataclass(frozen=True)
class Validity:
    """How far curvature bends the first-order picture, in units of its own standard deviations.

    ``curvature = sqrt(lambda_max(C1^+ C2))``, ``bias_mahalanobis = |C1^(-1/2) b|``, zero or more. Both are infinite
    where C1 has an axis of no width along which C2 or b is not zero: there the linear number is false however small the
    errors are. The relative error of C1 itself is dominated by the wide axis, where nothing is wrong.
    """

    curvature: float
    bias_mahalanobis: float

    @classmethod
    def of(cls, first_order: ArrayLike, second_order: ArrayLike, bias: ArrayLike) -> Validity:
        """The indices by C1 (m, m) [m²], C2 (m, m) [m²] and b (m,) [m]."""
        C1, C2 = np.asarray(first_order, dtype=float), np.asarray(second_order, dtype=float)
        b = np.asarray(bias, dtype=float).reshape(-1)
        variances, axes = np.linalg.eigh((C1 + C1.T) / 2)
        wide = variances > RANK_TOLERANCE * max(variances[-1], 0.0)
        span, null = axes[:, wide] / np.sqrt(variances[wide]), axes[:, ~wide]
        curvature = math.sqrt(_largest_eigenvalue(span.T @ C2 @ span))
        shift = float(np.linalg.norm(span.T @ b))
        if _largest_eigenvalue(null.T @ C2 @ null) > _MOTION_SHARE * np.trace(C2):
            curvature = math.inf
        if np.linalg.norm(null.T @ b) > math.sqrt(_MOTION_SHARE) * np.linalg.norm(b):
            shift = math.inf
        return cls(curvature, shift)

    @property
    def index(self) -> float:
        return max(self.curvature, self.bias_mahalanobis)

    @property
    def verdict(self) -> Verdict:
        return "good" if self.index < _MAX_GOOD_INDEX else "doubtful" if self.index < 0.5 else "wrong"

    @property
    def statement(self) -> Statement:
        """Whether the first-order ellipse may be used here."""
        if math.isinf(self.index):
            return state("uncertainty.first-order-singular")
        values = (Quantity(value, "number") for value in (self.curvature, self.bias_mahalanobis, _MAX_GOOD_INDEX))
        curvature, shift, limit = values
        return state(f"uncertainty.first-order-{self.verdict}", curvature=curvature, shift=shift, limit=limit)

    @property
    def text(self) -> str:
        return self.statement.text

    def to_json(self) -> dict[str, Json]:
        return {
            "curvature": finite_or_none(self.curvature),
            "curvature_infinite": math.isinf(self.curvature),
            "bias_mahalanobis": finite_or_none(self.bias_mahalanobis),
            "bias_infinite": math.isinf(self.bias_mahalanobis),
            "verdict": self.verdict,
            "text": self.text,
        }


def _largest_eigenvalue(matrix: Array) -> float:
    """Zero at least; of nothing, zero."""
    return max(float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[-1]), 0.0) if matrix.size else 0.0
