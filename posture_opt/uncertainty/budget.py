"""The error budget: which source the variance along a direction comes from, and which sources cancel each other.

The share of one of two correlated sources may be negative, and then says nothing about it alone. The joint share of
sources that are independent of all others is ``c_Gᵀ Σ_G c_G`` of the variance, never below zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.numerics import Array
from posture_opt.uncertainty.exact_moments import conditional_moments
from posture_opt.uncertainty.sources import stated_name
from posture_opt.uncertainty.tool_point import ToolPoint

# Of central differences in log σ: the truncation error h²/6 and the rounding error ε/h are both below 1e-8.
_LOG_SIGMA_STEP = 1e-4
SHARE_TOLERANCE = 5e-4  # of the variance: a share that is less below zero is none


@dataclass(frozen=True)
class Share:
    """The part of a variance that one source brings; the shares of all sources sum to one."""

    parameter: str
    share: float


@dataclass(frozen=True)
class ShareGroup:
    """Sources of error, the largest share first, and the part of a variance that they bring together."""

    parameters: tuple[str, ...]
    share: float


def budget(tool_point: ToolPoint, q: Sequence[float], direction: Sequence[float] | Array) -> tuple[Share, ...]:
    """The share of every source in the variance ``uᵀ C u`` of the tool point along ``u`` (3,), the largest first.

    ``share_i = e_i / Σ_j e_j`` with the elasticity ``e_i = ½ ∂(uᵀ C u) / ∂ log σ_i`` of the reported covariance at
    fixed correlations. To first order this is ``c_i Σ_j c_j Cov_ij`` (JCGM 100:2008, 5.1.3, 5.2.2); it stays defined at
    singular postures, where all sensitivities ``c_i`` vanish. All shares are zero where the variance is.
    """
    return budgets(tool_point, q, np.asarray(direction, dtype=float))[0]


def budgets(
    tool_point: ToolPoint, q: Sequence[float], directions: Sequence[Sequence[float]] | Array
) -> tuple[tuple[Share, ...], ...]:
    """The budget along each of the directions (m, 3), see :func:`budget`."""
    U = np.asarray(directions, dtype=float).reshape(-1, 3)
    posture, (names, covariance) = [float(v) for v in q], tool_point.every_source
    planar = tool_point.method == "exact, planar"
    gradient = _by_differences(tool_point, posture) if planar else _in_one_walk(tool_point, posture)
    if tool_point.linear is not None:
        chain, J, S = gradient, tool_point.every_column(posture), covariance.copy()
        S[: len(chain), : len(chain)] = 0.0
        parts = np.einsum("ai,bj,ij->iab", J, J, S)
        gradient = (parts + np.swapaxes(parts, 1, 2)) / 2
        gradient[: len(chain)] += chain
    return tuple(_sorted_shares(names, np.einsum("kab,a,b->k", gradient, u, u)) for u in U)


def _sorted_shares(names: Sequence[str], elasticity: Array) -> tuple[Share, ...]:
    """The elasticities (k,) over their sum, the largest first; all zero where the sum is rounding.

    The coordinates of an error of the workpiece are one source, as the file states them.
    """
    stated: dict[str, float] = {}
    for name, part in zip(names, elasticity, strict=True):
        stated[stated_name(name)] = stated.get(stated_name(name), 0.0) + float(part)
    total, size = sum(stated.values()), sum(map(abs, stated.values()))
    # Below this the sum is what rounding left of terms that cancel, and no share of it means anything.
    known = size > 0 and abs(total) > 1e-10 * size
    shares = [Share(name, part / total if known else 0.0) for name, part in stated.items()]
    return tuple(sorted(shares, key=lambda share: -share.share))


def _in_one_walk(tool_point: ToolPoint, q: list[float]) -> Array:
    """(k, 3, 3) ``½ ∂C / ∂ log σ_i`` [m²], all 2k variations side by side, with fixed nodes for shared factors.

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
        for segment in tool_point.segments(q, goal=1e-5)  # relative error of what shares are shares of
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


def share_groups(
    shares: Sequence[Share], tool_point: ToolPoint, q: Sequence[float], direction: Array
) -> tuple[ShareGroup, ...]:
    """A budget in which no share is negative, the largest first: sources by themselves, and those whose errors cancel.

    A source with a negative share along the unit vector ``direction`` (3,), world, joins the group that its error
    cancels with, that of the least ``Σ c_i Cov_ij c_j`` (JCGM 100:2008, 5.2.2), until no share is below zero.
    """
    groups = [[k] for k in range(len(shares))]
    total = np.array([share.share for share in shares])
    if np.all(total > -SHARE_TOLERANCE):
        return tuple(ShareGroup((share.parameter,), share.share) for share in shares)
    known, covariance = tool_point.every_source
    c = np.asarray(direction, dtype=float) @ tool_point.every_column([float(v) for v in q])
    of_share = np.array([[stated_name(one) == share.parameter for one in known] for share in shares], dtype=float)
    products = of_share @ (np.outer(c, c) * covariance) @ of_share.T
    while len(groups) > 1:
        sums = [float(total[group].sum()) for group in groups]
        worst = int(np.argmin(sums))
        if sums[worst] > -SHARE_TOLERANCE:
            break
        lost = groups.pop(worst)
        # Where the first order says nothing, in a singular posture, the largest group takes it.
        cancelled = [(float(products[np.ix_(lost, group)].sum()), -float(total[group].sum())) for group in groups]
        groups[min(range(len(groups)), key=cancelled.__getitem__)] += lost
    found = [ShareGroup(tuple(shares[k].parameter for k in sorted(g)), float(total[g].sum())) for g in groups]
    return tuple(sorted(found, key=lambda group: -group.share))
