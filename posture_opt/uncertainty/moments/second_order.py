"""Mean and covariance of the tool point complete to fourth order in σ, for errors correlated in any way.

``C = J Σ Jᵀ + ½ tr(H_a Σ H_b Σ) + ½ (J_a Σ g_b + J_b Σ g_a)`` with ``g_b = ∇ tr(Σ H_b)``; the mean moves by
``½ tr(Σ H)``. The third term is as large as the second and is often forgotten (JCGM 100:2008, note to 5.1.2,
gives both for one output). Second and third derivatives follow from the screws of the chain
(:mod:`posture_opt.model.chain`): ``H_ij = a_i × J_j`` and ``T_ijk = a_i × (a_j × J_k)`` for i ≤ j ≤ k.

`Validity` says from them whether the first-order ellipse may be trusted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from posture_opt.model.chain import (
    ZERO,
    Scalar,
    Vector,
    Walk,
    add,
    cross,
    position_column,
    rotation_column,
    scale,
    stack,
)
from posture_opt.numerics import Array, Json, finite_or_none
from posture_opt.statements import Quantity, Statement, state
from posture_opt.uncertainty.regions.regions import RANK_TOLERANCE


@dataclass(frozen=True)
class SecondOrder:
    """The parts of the expansion, world frame.

    Args:
        first: (3, 3) ``J Σ Jᵀ`` [m²].
        curvature: (3, 3) ``½ tr(H_a Σ H_b Σ)`` [m²].
        mixed: (3, 3) first-order times third-order term [m²].
        bias: (3,) ``½ tr(Σ H)`` [m].
    """

    first: Scalar
    curvature: Scalar
    mixed: Scalar
    bias: Scalar

    @property
    def covariance(self) -> Scalar:
        """(3, 3) covariance complete to O(σ⁴) [m²]."""
        return self.first + self.curvature + self.mixed


def second_order(walk: Walk, indices: Sequence[int], covariance: Array) -> SecondOrder:
    """The expansion at the pose of ``walk``.

    Args:
        walk: numbers, arrays (N,) or symbols.
        indices: (k,) factor that each source acts on, ascending: from the base to the tool.
        covariance: (k, k) Σ of the sources [rad, m].
    """
    if not indices:
        none = np.zeros((3, 3))
        return SecondOrder(none, none, none, np.zeros(3))
    J = [position_column(walk, i) for i in indices]
    a = [rotation_column(walk, i) for i in indices]
    S = [[float(entry) for entry in row] for row in covariance]
    k = len(J)
    H = [[_position_hessian(a, J, i, j) for j in range(k)] for i in range(k)]
    gradient = [_trace_gradient(a, J, H, S, i) for i in range(k)]
    jacobian = stack(list(zip(*J, strict=True)))
    g = stack(list(zip(*gradient, strict=True)))
    mixed = jacobian @ covariance @ transpose(g)
    HS = [stack([[H[i][j][c] for j in range(k)] for i in range(k)]) @ covariance for c in range(3)]
    curvature = [[_trace_of_product(HS[c], HS[d]) / 2 for d in range(3)] for c in range(3)]
    return SecondOrder(
        first=jacobian @ covariance @ transpose(jacobian),
        curvature=stack(curvature),
        mixed=(mixed + transpose(mixed)) / 2,
        bias=stack(scale(0.5, _weighted_hessian(S, H, 0))),
    )


def _position_hessian(a: Sequence[Vector], J: Sequence[Vector], i: int, j: int) -> Vector:
    """``∂²x/∂i∂j`` (3,) = ``a_first × J_last``, zero where the factor nearer to the base shifts."""
    first, last = min(i, j), max(i, j)
    return ZERO if a[first] is ZERO else cross(a[first], J[last])


def _weighted_hessian(S: list[list[float]], H: list[list[Vector]], start: int) -> Vector:
    """``Σ_jk S_jk H_jk`` over j, k ≥ start."""
    total = ZERO
    for j in range(start, len(S)):
        for k in range(start, len(S)):
            if S[j][k]:
                total = add(total, scale(S[j][k], H[j][k]))
    return total


def _trace_gradient(
    a: Sequence[Vector], J: Sequence[Vector], H: list[list[Vector]], S: list[list[float]], i: int
) -> Vector:
    """``∂/∂i Σ_jk S_jk H_jk`` (3,), sorted by how many of j, k are nearer to the base than i."""
    total = cross(a[i], _weighted_hessian(S, H, i)) if a[i] is not ZERO else ZERO
    for k in range(i, len(S)):
        lever = _weighted_axis(a, [(S[j][k], j) for j in range(i)])
        if a[i] is not ZERO and lever is not ZERO:
            total = add(total, scale(2.0, cross(lever, H[i][k])))
    for k in range(i):
        if a[k] is not ZERO:
            lever = _weighted_axis(a, [(S[j][k] if j == k else 2 * S[j][k], j) for j in range(k + 1)])
            if lever is not ZERO:
                total = add(total, cross(lever, cross(a[k], J[i])))
    return total


def _weighted_axis(a: Sequence[Vector], weights: Sequence[tuple[float, int]]) -> Vector:
    """``Σ_j w_j a_j`` (3,) over pairs (w_j, j)."""
    total = ZERO
    for weight, j in weights:
        if weight and a[j] is not ZERO:
            total = scale(weight, a[j]) if total is ZERO else add(total, scale(weight, a[j]))
    return total


def transpose(matrix: Scalar) -> Scalar:
    """The transpose of an SX, or of arrays with the batch axis first."""
    return matrix.T if isinstance(matrix, ca.SX) else np.swapaxes(matrix, -1, -2)


def _trace_of_product(A: Array | ca.SX, B: Array | ca.SX) -> Scalar:
    """``tr(A B)``."""
    if isinstance(A, ca.SX) or isinstance(B, ca.SX):
        return ca.trace(ca.SX(A) @ ca.SX(B))
    return np.sum(A * np.swapaxes(B, -1, -2), axis=(-1, -2))


Verdict = Literal["good", "doubtful", "wrong"]
"""``good``: use either covariance; ``doubtful`` and ``wrong``: use the exact one."""

MAX_GOOD_INDEX = 0.2
"""Up to here the nominal 95 % ellipse of planar arms held 94.5 % or more."""
MAX_DOUBTFUL_INDEX = 0.5
"""Up to here it held 92 %, then ever less."""
_MOTION_SHARE = 1e-9
"""Share of the second-order scatter from which a direction that the first order leaves at rest moves in truth.

Below it is the rounding of the direction itself.
"""


@dataclass(frozen=True)
class Validity:
    """How far curvature bends the first-order picture, in units of its own standard deviations.

    ``curvature = sqrt(lambda_max(C1^+ C2))`` with ``C1 = J S J'`` and ``C2_ab = 1/2 tr(H_a S H_b S)``;
    ``bias_mahalanobis = |C1^(-1/2) b|`` with ``b_a = 1/2 tr(H_a S)``. Both are infinite where C1 has an axis of no
    width along which C2 or b is not zero: there the linear number is false however small the errors are. The relative
    error of C1 itself does not show this: it is dominated by the wide axis, where nothing is wrong.

    Args:
        curvature, bias_mahalanobis: without unit, zero or more.
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
        curvature = math.sqrt(_largest_eigenvalue(span.T @ C2 @ span))
        shift = float(np.linalg.norm(span.T @ b))
        if _largest_eigenvalue(null.T @ C2 @ null) > _MOTION_SHARE * np.trace(C2):
            curvature = math.inf
        if np.linalg.norm(null.T @ b) > math.sqrt(_MOTION_SHARE) * np.linalg.norm(b):
            shift = math.inf
        return cls(curvature, shift)

    @property
    def index(self) -> float:
        """The larger of the two."""
        return max(self.curvature, self.bias_mahalanobis)

    @property
    def verdict(self) -> Verdict:
        """``good`` below 0.2, ``doubtful`` below 0.5, else ``wrong``."""
        return "good" if self.index < MAX_GOOD_INDEX else "doubtful" if self.index < MAX_DOUBTFUL_INDEX else "wrong"

    @property
    def statement(self) -> Statement:
        """Whether the first-order ellipse may be used here."""
        if math.isinf(self.index):
            return state("uncertainty.first-order-singular")
        values = (Quantity(value, "number") for value in (self.curvature, self.bias_mahalanobis, MAX_GOOD_INDEX))
        curvature, shift, limit = values
        return state(f"uncertainty.first-order-{self.verdict}", curvature=curvature, shift=shift, limit=limit)

    @property
    def text(self) -> str:
        """The verdict in a sentence."""
        return self.statement.text

    def to_json(self) -> dict[str, Json]:
        """Indices, null where infinite (then the flag next to it is true), verdict and sentence."""
        return {
            "curvature": finite_or_none(self.curvature),
            "curvature_infinite": math.isinf(self.curvature),
            "bias_mahalanobis": finite_or_none(self.bias_mahalanobis),
            "bias_infinite": math.isinf(self.bias_mahalanobis),
            "verdict": self.verdict,
            "text": self.statement.text,
        }


def _largest_eigenvalue(matrix: Array) -> float:
    """The largest eigenvalue, zero at least; of nothing, zero."""
    return max(float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[-1]), 0.0) if matrix.size else 0.0
