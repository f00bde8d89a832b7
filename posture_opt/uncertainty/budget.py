"""The error budget: which source the variance along a direction comes from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.model.chain import Walk, position_column, rotation_column
from posture_opt.numerics import Array
from posture_opt.uncertainty.exact_moments import exact_moments
from posture_opt.uncertainty.tool_point import ToolPoint

# Central differences in log σ: the truncation error h²/6 and the rounding error ε/h are both below 1e-8.
_STEP = 1e-4


@dataclass(frozen=True)
class Share:
    """The part of a variance that one source brings; the shares of all sources sum to one."""

    parameter: str
    share: float


def budget(tool_point: ToolPoint, q: Sequence[float], direction: Sequence[float] | Array) -> tuple[Share, ...]:
    """The share of every source in the variance ``uᵀ C u`` of the tool point along ``u``, the largest first.

    ``share_i = e_i / Σ_j e_j`` with the elasticity ``e_i = ½ ∂(uᵀ C u) / ∂ log σ_i`` of the reported covariance at
    fixed correlations. To first order this is the GUM's ``c_i Σ_j c_j Cov_ij`` and independent sources share
    ``c_i² σ_i²``; it stays defined at singular postures, where all sensitivities ``c_i`` vanish. A source whose
    correlation with others makes the variance smaller has a negative share. All shares are zero where the
    variance is.

    Args:
        q: (n,) posture [rad or m].
        direction: (3,) in the world frame; its length does not matter.

    Source: JCGM 100:2008, 5.1.3 and 5.2.2 for the first order.
    """
    return budgets(tool_point, q, np.asarray(direction, dtype=float))[0]


def budgets(
    tool_point: ToolPoint, q: Sequence[float], directions: Sequence[Sequence[float]] | Array
) -> tuple[tuple[Share, ...], ...]:
    """The budget along each of the directions (m, 3), see :func:`budget`."""
    U = np.asarray(directions, dtype=float).reshape(-1, 3)
    posture = [float(v) for v in q]
    names, gradient = tool_point.names, _gradient(tool_point, posture)
    if tool_point.effects is not None:
        names, gradient = _with_effects(tool_point, posture, gradient)
    return tuple(_shares(names, np.einsum("kab,a,b->k", gradient, u, u)) for u in U)


def _with_effects(tool_point: ToolPoint, q: list[float], gradient: Array) -> tuple[tuple[str, ...], Array]:
    """Names and gradient with the parameters of effects behind those of the chain, to first order."""
    beside = tool_point.effects
    assert beside is not None
    reached = tool_point.walk(q)[0]
    E = np.asarray(tool_point.effect_columns(q, reached), dtype=float)
    J = np.asarray(tool_point.jacobian(reached), dtype=float)
    shared = np.einsum("ak,be,ke->kab", J, E, beside.cross)
    own = np.einsum("ae,bf,ef->eab", E, E, beside.covariance) + np.einsum("ae,bk,ke->eab", E, J, beside.cross)
    both = np.concatenate([gradient + (shared + np.swapaxes(shared, 1, 2)) / 2, (own + np.swapaxes(own, 1, 2)) / 2])
    return (*tool_point.names, *beside.names), both


def _shares(names: Sequence[str], elasticity: Array) -> tuple[Share, ...]:
    total = float(elasticity.sum())
    size = float(np.abs(elasticity).sum())
    # Below this the sum is what rounding left of terms that cancel, and no share of it means anything.
    known = size > 0 and abs(total) > 1e-10 * size
    shares = elasticity / total if known else np.zeros(len(names))
    order = sorted(range(len(names)), key=lambda k: (-shares[k], k))
    return tuple(Share(names[k], float(shares[k])) for k in order)


def _gradient(tool_point: ToolPoint, q: list[float]) -> Array:
    """(k, 3, 3) ``½ ∂C / ∂ log σ_i`` [m²]."""
    if tool_point.method == "exact, planar":
        return _by_differences(tool_point, q)
    gradient = _independent(tool_point, q)
    if not tool_point.correlated:
        return gradient
    taylor = _Taylor.of(tool_point.walk(q)[0], tool_point.indices)
    S = tool_point.covariance
    return gradient + taylor.gradient(S) - taylor.gradient(np.diag(np.diag(S)))


def _independent(tool_point: ToolPoint, q: list[float]) -> Array:
    """The gradient of the exact covariance of independent sources: all 2k variations in one walk."""
    k = len(tool_point.indices)
    values = tool_point.arm.reach(q).values
    variances: list[float | Array] = [0.0] * len(values)
    for i, (index, variance) in enumerate(zip(tool_point.indices, np.diag(tool_point.covariance), strict=True)):
        varied = np.full(2 * k, float(variance))
        varied[[i, i + k]] *= np.exp([2 * _STEP, -2 * _STEP])
        variances[index] = varied
    _, C = exact_moments(tool_point.robot.factors, values, variances)
    full = np.array([[np.broadcast_to(entry, 2 * k) for entry in row] for row in C])
    gradient: Array = np.moveaxis(full[..., :k] - full[..., k:], -1, 0) / (4 * _STEP)
    return gradient


def _by_differences(tool_point: ToolPoint, q: list[float]) -> Array:
    def covariance(i: int, step: float) -> Array:
        scale = np.ones(len(tool_point.names))
        scale[i] = np.exp(step)
        varied = replace(tool_point, covariance=tool_point.covariance * np.outer(scale, scale))
        return np.asarray(varied.moments(q).covariance)

    k = len(tool_point.names)
    changes = [covariance(i, _STEP) - covariance(i, -_STEP) for i in range(k)]
    return np.array(changes).reshape(k, 3, 3) / (4 * _STEP)


@dataclass(frozen=True)
class _Taylor:
    """Derivatives of the tool point by the sources as arrays: J (k, 3), H (k, k, 3), T (k, k, k, 3)."""

    J: Array
    H: Array
    T: Array

    @classmethod
    def of(cls, reached: Walk, indices: Sequence[int]) -> _Taylor:
        J = np.array([position_column(reached, i) for i in indices], dtype=float)
        a = np.array([rotation_column(reached, i) for i in indices], dtype=float)
        i, j = np.sort(np.indices((len(J),) * 2), axis=0)
        H = np.cross(a[i], J[j])
        i, j, k = np.sort(np.indices((len(J),) * 3), axis=0)
        return cls(J, H, np.cross(a[i], H[j, k]))

    def gradient(self, S: Array) -> Array:
        """(k, 3, 3) ``½ ∂C / ∂ log σ_i`` of the covariance complete to fourth order, see `second_order`."""
        J, H, T = self.J, self.H, self.T
        SJ = S @ J
        g = np.einsum("ijkc,jk->ic", T, S)
        HS = np.einsum("ijc,jk->cik", H, S)
        first = np.einsum("ia,ib->iab", J, SJ)
        curvature = np.einsum("aij,bji->iab", HS, HS)
        # S acts on the left of the product J S g(S) and, through g, once more inside it.
        outside = np.einsum("ia,ib->iab", J, S @ g) / 2 + np.einsum("ia,ib->iab", SJ, g) / 2
        inside = np.einsum("ijab,ij->iab", np.tensordot(T, SJ, axes=(0, 0)), S)
        full = first + curvature + outside + inside
        symmetric: Array = (full + np.swapaxes(full, 1, 2)) / 2
        return symmetric
