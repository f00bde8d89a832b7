"""The error budget: which source the variance along a direction comes from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.numerics import Array
from posture_opt.uncertainty.moments.conditional_moments import conditional_moments
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.sources.workpiece import stated_name

_LOG_SIGMA_STEP = 1e-4
"""Step of central differences in log σ: the truncation error h²/6 and the rounding error ε/h are both below 1e-8."""
_VARIANCE_TOLERANCE = 1e-5
"""Relative error of the variances that the shares are shares of."""


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
    names, gradient = tool_point.names, _covariance_gradient(tool_point, posture)
    if tool_point.linear is not None:
        names, gradient = _with_linear(tool_point, posture, gradient)
    return tuple(_sorted_shares(names, np.einsum("kab,a,b->k", gradient, u, u)) for u in U)


def _with_linear(tool_point: ToolPoint, q: list[float], gradient: Array) -> tuple[tuple[str, ...], Array]:
    """Names and gradient with the sources that act to first order behind those of the chain."""
    linear = tool_point.linear
    assert linear is not None
    reached = tool_point.walk(q)[0]
    E = np.asarray(tool_point.linear_columns(q, reached), dtype=float)
    J = np.asarray(tool_point.jacobian(reached), dtype=float)
    shared = np.einsum("ak,be,ke->kab", J, E, linear.cross)
    own = np.einsum("ae,bf,ef->eab", E, E, linear.covariance) + np.einsum("ae,bk,ke->eab", E, J, linear.cross)
    both = np.concatenate([gradient + (shared + np.swapaxes(shared, 1, 2)) / 2, (own + np.swapaxes(own, 1, 2)) / 2])
    return (*tool_point.names, *linear.names), both


def _sorted_shares(names: Sequence[str], elasticity: Array) -> tuple[Share, ...]:
    """The elasticities (k,) over their sum, the largest first; all zero where the sum is rounding.

    The coordinates of an error of the workpiece are one source, as the file states them.
    """
    names, elasticity = _as_stated(names, elasticity)
    total = float(elasticity.sum())
    size = float(np.abs(elasticity).sum())
    # Below this the sum is what rounding left of terms that cancel, and no share of it means anything.
    known = size > 0 and abs(total) > 1e-10 * size
    shares = elasticity / total if known else np.zeros(len(names))
    order = sorted(range(len(names)), key=lambda k: (-shares[k], k))
    return tuple(Share(names[k], float(shares[k])) for k in order)


def _as_stated(names: Sequence[str], elasticity: Array) -> tuple[list[str], Array]:
    """Names and elasticities as the file states the sources: coordinates of one error together."""
    stated: dict[str, float] = {}
    for name, part in zip(names, elasticity, strict=True):
        stated[stated_name(name)] = stated.get(stated_name(name), 0.0) + float(part)
    return list(stated), np.array(list(stated.values()))


def _covariance_gradient(tool_point: ToolPoint, q: list[float]) -> Array:
    """(k, 3, 3) ``½ ∂C / ∂ log σ_i`` [m²]."""
    return _by_differences(tool_point, q) if tool_point.method == "exact, planar" else _in_one_walk(tool_point, q)


def _in_one_walk(tool_point: ToolPoint, q: list[float]) -> Array:
    """The gradient with fixed nodes for shared factors, if there are any: all 2k variations side by side.

    A standard deviation that grows at fixed correlations scales what the source has for itself and by each factor.
    """
    k = len(tool_point.indices)
    steps = np.ones((k, 2 * k, 1))
    each = np.arange(k)
    steps[each, each], steps[each, each + k] = np.exp(_LOG_SIGMA_STEP), np.exp(-_LOG_SIGMA_STEP)
    scale = dict(zip(tool_point.indices, steps, strict=True))
    own: list[float | Array] = list(tool_point.variances(tool_point.shared.own))
    for index, factor in scale.items():
        own[index] = own[index] * factor**2
    segments = [
        replace(segment, loadings={index: scale[index] * row for index, row in segment.loadings.items()})
        for segment in tool_point.segments(q, _VARIANCE_TOLERANCE)
    ]
    _, C = conditional_moments(tool_point.robot.factors, tool_point.arm.reach(q).values, own, segments)
    full = np.array([[np.broadcast_to(entry, (2 * k, 1))[:, 0] for entry in row] for row in C])
    gradient: Array = np.moveaxis(full[..., :k] - full[..., k:], -1, 0) / (4 * _LOG_SIGMA_STEP)
    return gradient


def _by_differences(tool_point: ToolPoint, q: list[float]) -> Array:
    """(k, 3, 3) the gradient [m²] by two evaluations for each source, as a planar closed form takes one covariance."""

    def covariance(i: int, step: float) -> Array:
        scale = np.ones(len(tool_point.names))
        scale[i] = np.exp(step)
        varied = replace(tool_point, covariance=tool_point.covariance * np.outer(scale, scale))
        return np.asarray(varied.moments(q).covariance)

    k = len(tool_point.names)
    changes = [covariance(i, _LOG_SIGMA_STEP) - covariance(i, -_LOG_SIGMA_STEP) for i in range(k)]
    return np.array(changes).reshape(k, 3, 3) / (4 * _LOG_SIGMA_STEP)
