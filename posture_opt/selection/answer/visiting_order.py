"""In which order to visit postures, so that the joints travel least."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import TURN, Array
from posture_opt.robot.robot import Robot

_MAX_EXACT_POSTURES = 12  # postures: 2^12 x 12 states of the dynamic program take half a second
_TRAVEL_TOLERANCE = 1e-3  # of the travel: less is not worth another order


@dataclass(frozen=True)
class VisitingOrder:
    """An open tour over postures.

    Args:
        order: indices of the postures in the order of visits.
        travel: sum over the moves of the largest change of a joint [rad; m for an arm that only slides].
        as_listed: the same in the order that they are listed in.
        exact: whether no order is better.
    """

    order: tuple[int, ...]
    travel: float
    as_listed: float
    exact: bool


def moves(robot: Robot, Q: Array) -> Array:
    """(K, K) largest change of a joint between postures (K, n); slides are left out where other joints turn."""
    turns = np.array([joint.type == "revolute" for joint in robot.joints])
    counted = Q[:, turns] if turns.any() else Q
    return np.asarray(np.abs(counted[:, None] - counted[None]).max(axis=2))


def best_order(robot: Robot, Q: Array) -> VisitingOrder:
    """The open tour of least travel: by dynamic programming (Held and Karp 1962) up to 12 postures, else by 2-opt."""
    D = moves(robot, Q)
    listed = list(range(len(Q)))
    order = _held_karp(D) if len(Q) <= _MAX_EXACT_POSTURES else _two_opt(D)
    # As listed where that is as good: nobody likes to visit in another order for nothing.
    if _length(D, order) >= (1 - _TRAVEL_TOLERANCE) * _length(D, listed):
        order = listed
    elif order[0] > order[-1]:
        order = order[::-1]
    return VisitingOrder(tuple(order), _length(D, order), _length(D, listed), len(Q) <= _MAX_EXACT_POSTURES)


def nearest_turns(robot: Robot, Q: Array, order: Sequence[int]) -> Array:
    """The same postures (K, n), joints turned by whole turns within their limits to be near the one visited before."""
    near = np.array(Q)
    turning = np.array([joint.type == "revolute" for joint in robot.joints])
    for before, k in itertools.pairwise(order):
        wanted = np.rint((near[before] - near[k]) / TURN)
        least = np.ceil((robot.lower - near[k]) / TURN - 1e-9)
        most = np.floor((robot.upper - near[k]) / TURN + 1e-9)
        turns = np.where(turning & (least <= most), np.clip(wanted, least, most), 0.0)
        near[k] = np.clip(near[k] + turns * TURN, robot.lower, robot.upper)
    return near


def nearest_ties(robot: Robot, options: Sequence[Array]) -> list[int]:
    """Of each posture's equally good ones (A_k, n) the one with which the tour is short; the first ones in a tie.

    Each of them is the anchor once that the others' nearest ones are chosen by; whole turns count as none.
    """
    firsts = [0] * len(options)
    best, shortest = firsts, _short_tour(robot, options, firsts)
    for anchors in options:
        for anchor in anchors:
            chosen = [int(np.argmin(np.round(_apart(robot, each, anchor), 6))) for each in options]
            length = _short_tour(robot, options, chosen)
            if length < (1 - _TRAVEL_TOLERANCE) * shortest:
                best, shortest = chosen, length
    return best


def _short_tour(robot: Robot, options: Sequence[Array], chosen: Sequence[int]) -> float:
    """Length of a short tour through one posture of each set: nearest neighbours from every first one."""
    Q = np.array([each[k] for each, k in zip(options, chosen, strict=True)])
    D = np.array([_apart(robot, Q, q) for q in Q])
    return min(_length(D, _nearest_first(D, first)) for first in range(len(Q)))


def _apart(robot: Robot, Q: Array, q: Array) -> Array:
    """(A,) largest difference of a joint between postures (A, n) and one (n,), whole turns taken off."""
    turns = np.array([joint.type == "revolute" for joint in robot.joints])
    away = Q - q
    away = np.where(turns, away - TURN * np.rint(away / TURN), away)
    return np.asarray(np.abs(away[:, turns] if turns.any() else away).max(axis=1))


def _length(D: Array, order: Sequence[int]) -> float:
    """Sum of the moves of an open tour."""
    return float(sum(D[a, b] for a, b in itertools.pairwise(order)))


def _held_karp(D: Array) -> list[int]:
    """The shortest open tour by dynamic programming over subsets, O(2^K K²).

    Source: M. Held and R. M. Karp, J. SIAM 10 (1962) 196.
    """
    K = len(D)
    cost = np.full((1 << K, K), np.inf)
    came = np.zeros((1 << K, K), dtype=int)
    for k in range(K):
        cost[1 << k, k] = 0.0
    for visited in range(1, 1 << K):
        for last in (k for k in range(K) if visited >> k & 1 and np.isfinite(cost[visited, k])):
            reach = cost[visited, last] + D[last]
            for following in (k for k in range(K) if not visited >> k & 1):
                there = visited | 1 << following
                if reach[following] < cost[there, following] - 1e-12:
                    cost[there, following], came[there, following] = reach[following], last
    visited, last = (1 << K) - 1, int(np.argmin(cost[-1]))
    order = [last]
    while visited & (visited - 1):
        visited, last = visited & ~(1 << last), int(came[visited, last])
        order.append(last)
    return order[::-1]


def _two_opt(D: Array) -> list[int]:
    """From the nearest neighbour of each posture in turn, parts reversed while that shortens the tour; the best."""
    return min((_improved_tour(D, _nearest_first(D, first)) for first in range(len(D))), key=lambda o: _length(D, o))


def _nearest_first(D: Array, first: int) -> list[int]:
    """The tour that goes on to the nearest posture each time."""
    order, left = [first], set(range(len(D))) - {first}
    while left:
        order.append(min(left, key=lambda k: (D[order[-1], k], k)))
        left.remove(order[-1])
    return order


def _improved_tour(D: Array, order: list[int]) -> list[int]:
    """The tour with parts reversed while that shortens it (2-opt)."""
    better = True
    while better:
        better = False
        for i in range(len(order) - 1):
            for j in range(i + 1, len(order)):
                turned = [*order[:i], *order[i : j + 1][::-1], *order[j + 1 :]]
                if _length(D, turned) < _length(D, order) - 1e-9:
                    order, better = turned, True
    return order
