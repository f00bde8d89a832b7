"""Shares of sources that vary together: one share for those whose errors cancel.

The share of one of two correlated sources may be negative, and then says nothing about it alone. The joint share of
sources that are independent of all others is ``c_Gᵀ Σ_G c_G`` of the variance, never below zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array
from posture_opt.uncertainty.moments.tool_point import ToolPoint
from posture_opt.uncertainty.sources.workpiece import stated_name
from posture_opt.uncertainty.spread.budget import Share

SHARE_TOLERANCE = 5e-4
"""Share of the variance: a share that is less below zero is none."""


@dataclass(frozen=True)
class ShareGroup:
    """Sources of error, the largest share first, and the part of a variance that they bring together."""

    parameters: tuple[str, ...]
    share: float


def share_groups(
    shares: Sequence[Share], tool_point: ToolPoint, q: Sequence[float], direction: Array
) -> tuple[ShareGroup, ...]:
    """A budget in which no share is negative: sources by themselves, and those together whose errors cancel.

    A source with a negative share joins the group that its error cancels with, that of the least
    ``Σ c_i Cov_ij c_j``, until no share is below zero. Shares of all groups sum to one; the largest is first.

    Args:
        shares: of one variance, see `budget`.
        tool_point, q, direction: whose, at which posture (n,), along which unit vector (3,), world.

    Source: JCGM 100:2008, 5.2.2 for the products; the grouping is ours.
    """
    groups = [[k] for k in range(len(shares))]
    total = np.array([share.share for share in shares])
    if np.all(total > -SHARE_TOLERANCE):
        return tuple(ShareGroup((share.parameter,), share.share) for share in shares)
    products = _covariance_products([share.parameter for share in shares], tool_point, q, direction)
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


def _covariance_products(names: Sequence[str], tool_point: ToolPoint, q: Sequence[float], direction: Array) -> Array:
    """(k, k) ``c_i Cov_ij c_j`` [m²] of the named sources, to first order."""
    reached = tool_point.walk([float(v) for v in q])[0]
    known, covariance = list(tool_point.names), tool_point.covariance
    J = np.asarray(tool_point.jacobian(reached), dtype=float)
    if tool_point.linear is not None:
        linear = tool_point.linear
        J = np.hstack([J, np.asarray(tool_point.linear_columns(q, reached), dtype=float)])
        known += linear.names
        covariance = np.block([[covariance, linear.cross], [linear.cross.T, linear.covariance]])
    c = np.asarray(direction, dtype=float) @ J
    # The coordinates of an error of the workpiece are one source.
    of_name = np.array([[stated_name(one) == name for one in known] for name in names], dtype=float)
    return np.asarray(of_name @ (np.outer(c, c) * covariance) @ of_name.T)
