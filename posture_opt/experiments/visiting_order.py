"""The order in which postures are visited: little joint travel, and no leg through what has to be kept clear of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array, Codes, Mask

_POINTS = 9  # along each leg that are looked at
_DETOUR = 10.0  # turns that a leg through something counts for
_PASSES = 60  # of reversing parts of the tour


@dataclass(frozen=True, eq=False)
class Tour:
    """Postures in the order of their visit.

    Args:
        order: (N,) indices of the postures.
        travel: sum over the legs of the largest joint move [rad], as the tour goes and as the postures came.
        blocked: legs (counted from 0, leg k leads to the posture k + 1 of the tour) that a straight move in joint
            space leads through what is not allowed.
        sides: (n,) share of the legs on which each joint arrives from below.
    """

    order: Codes
    travel: float
    unordered: float
    blocked: tuple[int, ...]
    sides: Array


def tour(q: Array, lengths: Array, allowed: Callable[[Array], Mask]) -> Tour:
    """A short way through postures (N, n): nearest neighbour, then parts reversed as long as that helps (2-opt).

    Args:
        lengths: (n,) joint travel that counts as one radian: 1 for revolute joints, an arm's length for slides.
        allowed: which postures may be passed through.
    """
    n = len(q)
    if n < 2:
        return Tour(np.arange(n), 0.0, 0.0, (), np.full(q.shape[1], np.nan))
    far = np.abs(q[:, None] - q[None]) / lengths
    distance = far.max(axis=2)
    through = _through(q, allowed)
    cost = distance + 2 * np.pi * _DETOUR * through
    order = _reversed(_nearest(cost), cost)
    a, b = order[:-1], order[1:]
    moves = q[b] - q[a]
    with np.errstate(invalid="ignore"):
        sides = np.sum(moves > 0, axis=0) / np.sum(moves != 0, axis=0)
    blocked = tuple(int(k) for k in np.flatnonzero(through[a, b]))
    unordered = distance[np.arange(n - 1), np.arange(1, n)]
    return Tour(order, float(distance[a, b].sum()), float(unordered.sum()), blocked, sides)


def _through(q: Array, allowed: Callable[[Array], Mask]) -> Mask:
    """(N, N) whether the straight move between two postures leads through what is not allowed."""
    n = len(q)
    i, j = np.triu_indices(n, 1)
    free = np.ones(len(i), dtype=bool)
    for share in np.linspace(0, 1, _POINTS + 2)[1:-1]:
        free &= allowed((1 - share) * q[i] + share * q[j])
    through = np.zeros((n, n), dtype=bool)
    through[i, j] = through[j, i] = ~free
    return through


def _nearest(cost: Array) -> Codes:
    """From posture 0, always on to the nearest that is left."""
    left = cost.copy()
    order = [0]
    for _ in range(len(cost) - 1):
        left[:, order[-1]] = np.inf
        order.append(int(np.argmin(left[order[-1]])))
    return np.array(order, dtype=np.intp)


def _reversed(order: Codes, cost: Array) -> Codes:
    """The open tour with parts reversed, the best reversal of each start first, until none shortens it."""
    n = len(order)
    for _ in range(_PASSES):
        shorter = False
        for i in range(n - 1):
            ends = np.arange(i + 1, n)  # the part i … j is reversed
            before = np.zeros(len(ends)) if i == 0 else cost[order[i - 1], order[i]] - cost[order[i - 1], order[ends]]
            after = cost[order[ends[:-1]], order[ends[:-1] + 1]] - cost[order[i], order[ends[:-1] + 1]]
            gain = before + np.append(after, 0.0)
            best = int(np.argmax(gain))
            if gain[best] > 1e-9:
                j = ends[best]
                order[i : j + 1] = order[i : j + 1][::-1]
                shorter = True
        if not shorter:
            break
    return order
