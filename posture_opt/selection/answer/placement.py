"""Stations of one workpiece: where it may stand and stands, how objectives become one, in which order to visit."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from posture_opt.encoding import Encoded
from posture_opt.numerics import TURN, Array, Mask, finite_or_none
from posture_opt.robot.robot import Robot
from posture_opt.selection.tasks.workpiece import Combine, Workpiece
from posture_opt.statements import Quantity

COORDINATES = ("x", "y", "z", "yaw")
_IRRATIONAL_STEPS = np.sqrt([2.0, 3.0, 5.0, 7.0])
# What a person sets up: 0.1 mm and 0.01 degrees.
_SETTING_STEPS = np.array([1e-4, 1e-4, 1e-4, math.radians(0.01)])


@dataclass(frozen=True)
class PlacementRange:
    """A box of placements w = (x, y, z, yaw) [m, rad], ``Trans(x, y, z) Rz(yaw)`` in the world."""

    lower: Array  # (4,)
    upper: Array  # (4,), equal where a coordinate is fixed

    @classmethod
    def of(cls, workpiece: Workpiece | None) -> PlacementRange:
        """The range of a task's workpiece; its frame is the world's by default."""
        stated = workpiece or Workpiece()
        return cls(np.array(stated.lower), np.array(stated.upper))

    @property
    def free(self) -> Mask:
        """(4,) which coordinates may be chosen."""
        return np.asarray(self.upper > self.lower)

    @property
    def centre(self) -> Array:
        """(4,) the middle of the box."""
        return (self.lower + self.upper) / 2

    @property
    def all_round(self) -> bool:
        """Whether the yaw goes through a whole turn, so that its ends are none."""
        return bool(self.upper[3] - self.lower[3] >= TURN - 1e-9)

    @property
    def without_seam(self) -> PlacementRange:
        """The box for a local search: half a turn more on either side of a full yaw."""
        if not self.all_round:
            return self
        more = np.array([0.0, 0.0, 0.0, TURN / 2])
        return PlacementRange(self.lower - more, self.upper + more)

    def drawn(self, count: int, rng: np.random.Generator) -> Array:
        """(count, 4) multiples of irrational steps (R. D. Richtmyer, Los Alamos report LA-1342, 1951)."""
        steps = np.outer(np.arange(1, count + 1), _IRRATIONAL_STEPS)
        return self.lower + ((steps + rng.random(4)) % 1.0) * (self.upper - self.lower)

    def near(self, w: Array, share: float, count: int, rng: np.random.Generator) -> Array:
        """(count, 4) placements in a box of that ``share`` of this one about ``w``."""
        away = rng.uniform(-0.5, 0.5, (count, 4)) * share * (self.upper - self.lower)
        return np.clip(w + away, self.lower, self.upper)

    def tidied(self, w: Array) -> Array:
        """(4,) a placement as people write it: tenths of a millimetre, hundredths of a degree, turns taken off."""
        turned = np.array(w)
        if self.all_round:
            turned[3] = self.lower[3] + (turned[3] - self.lower[3]) % TURN
        rounded = np.where(self.free, np.rint(turned / _SETTING_STEPS) * _SETTING_STEPS, turned)
        return np.clip(rounded, self.lower, self.upper)


def placement_text(w: Array, placement: PlacementRange) -> str:
    """A placement w (4,) [m, rad] in a line, with the coordinates that are fixed or at an end."""
    texts = []
    for k, name in enumerate(COORDINATES):
        text = f"{name} {Quantity(float(w[k]), 'coordinate' if k < 3 else 'joint angle')}"
        if not placement.free[k]:
            text += " (fixed)" * bool(np.any(placement.free))
        elif k < 3 or not placement.all_round:
            text += " (end of its range)" * bool(min(w[k] - placement.lower[k], placement.upper[k] - w[k]) < 1e-9)
        texts.append(text)
    return ", ".join(texts)


def placement_json(w: Array) -> dict[str, float]:
    """x, y, z [m] and yaw [rad] by name."""
    return dict(zip(COORDINATES, map(float, w), strict=True))


@dataclass(frozen=True)
class PlacementFigure:
    w: Array  # (4,) of the workpiece [m, rad], world
    sigma: float  # [m] of the worst station, or the mean; infinite where one cannot be done
    success: float | None = None  # probability that all stations succeed, where that counts

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, SI; no spread where a station cannot be done."""
        figures = {"sigma": finite_or_none(self.sigma), "success_all": self.success}
        return {"workpiece": placement_json(self.w), **figures}


@dataclass(frozen=True)
class PlacementStatistics:
    placements: int  # looked at
    feasible: int  # with a posture for every station
    starts: int  # random postures led to stations
    solves: int  # of the program of all stations
    batches: int
    recurred: int  # batches that found the best optimum
    seconds: float


@dataclass(frozen=True)
class BenchMap:
    """Best spread over two coordinates of the placement, the others as in the answer."""

    axes: tuple[int, int]  # which two coordinates, 0 to 3
    values: tuple[Array, Array]  # of each of them [m or rad]
    sigma: Array  # (len(values[0]), len(values[1])) [m]; NaN where a feature cannot be done


@dataclass(frozen=True)
class Placement(Encoded, PlacementRange, json="centre=at_centre typical others"):
    """The placement that the stations of an answer share, in the range where the workpiece may stand."""

    w: Array  # (4,) x, y, z [m] and yaw [rad] of the workpiece, world
    statistics: PlacementStatistics | None = None  # None where it was searched for with its path
    at_centre: PlacementFigure | None = None  # None where the placement is fixed, or not feasible
    typical: PlacementFigure | None = None  # median of random feasible placements
    others: tuple[PlacementFigure, ...] = ()  # further optima, best first

    @property
    def workpiece(self) -> dict[str, float]:
        """x, y, z [m] and yaw [rad] of the workpiece, by name."""
        return placement_json(self.w)

    @property
    def central(self) -> float:
        """Standard deviation [m] in the middle of the range; NaN where that was not tried, or is not feasible."""
        return math.nan if self.at_centre is None else self.at_centre.sigma

    @property
    def search_json(self) -> dict[str, Any]:
        """What the part ``solver`` of ``solution.json`` says of the search for it."""
        return {} if self.statistics is None else vars(self.statistics)

    def bench(self, postures: Array) -> BenchMap | None:
        """A map of the spread over the placement, from postures (K, n), or None."""
        return None


ALMOST_ONE = 1 - 1e-9  # of a probability to miss: the logarithm of its complement stays finite


def combined_symbols(combine: Combine, main: ca.MX, extra: ca.MX) -> ca.MX:
    """The objective of K stations, from terms f = ``main`` and e = ``extra`` (K, 1).

    ``worst``: ``max(f_k + e_k)``; ``mean``: ``Σ sqrt(f_k)/K + Σ e_k/K``; ``success``, f logarithms of the probability
    to miss: ``log(−Σ log(1 − exp f_k)) + Σ e_k/K``.
    """
    if combine == "worst":
        return ca.mmax(main + extra)
    count = main.shape[0]
    further = ca.sum1(extra) / count
    if combine == "mean":
        return ca.sum1(ca.sqrt(ca.fmax(main, 0) + 1e-12)) / count + further
    return ca.log(ca.sum1(-ca.log1p(-ALMOST_ONE * ca.exp(main)))) + further


def combined_success(success: ca.MX, extra: ca.MX) -> ca.MX:
    """``log(−log P) + Σ e_k/K``, P the mean over N draws of shared errors of the product of ``success`` (K, N)."""
    count, draws = success.shape
    product = success[0, :]
    for k in range(1, count):
        product *= success[k, :]
    return ca.log(-ca.log(ALMOST_ONE * ca.sum2(product) / draws + 1e-300)) + ca.sum1(extra) / count


def combined_numbers(combine: Combine, main: Array, extra: Array) -> Array:
    """(M,) objectives of numbers (M, K); first terms are infinite at a station without a posture."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if combine == "worst":
            return np.asarray((main + extra).max(axis=1))
        further = extra.mean(axis=1)
        if combine == "mean":
            return np.asarray(np.sqrt(np.maximum(main, 0.0)).mean(axis=1) + further)
        total = np.log(np.sum(-np.log1p(-np.exp(np.minimum(main, -1e-9))), axis=1)) + further
    return np.where(np.isfinite(main).all(axis=1), total, np.inf)


def combined_sigma(combine: Combine, sigma: Array) -> Array:
    """(...) stated standard deviation [m] of stations (..., K)."""
    return np.asarray(sigma.mean(axis=-1) if combine == "mean" else sigma.max(axis=-1))


_MAX_EXACT_POSTURES = 12  # postures: 2^12 x 12 states of the dynamic program take half a second
_TRAVEL_TOLERANCE = 1e-3  # of the travel: less is not worth another order


@dataclass(frozen=True)
class VisitingOrder:
    """An open tour over postures; travel is the sum of the largest joint changes [rad; m for slides alone]."""

    order: tuple[int, ...]
    travel: float
    as_listed: float  # travel in the order of the list
    exact: bool  # no order is better


def moves(robot: Robot, Q: Array) -> Array:
    """(K, K) largest change of a joint between postures (K, n); slides are left out where other joints turn."""
    turns = _turning(robot)
    counted = Q[:, turns] if turns.any() else Q
    return np.asarray(np.abs(counted[:, None] - counted[None]).max(axis=2))


def best_order(robot: Robot, Q: Array) -> VisitingOrder:
    """The open tour of least travel: by dynamic programming (Held and Karp 1962) up to 12 postures, else by 2-opt."""
    D = moves(robot, Q)
    listed = list(range(len(Q)))
    order = (
        _held_karp(D)
        if len(Q) <= _MAX_EXACT_POSTURES
        else min((_improved_tour(D, _nearest_first(D, first)) for first in range(len(D))), key=lambda o: _length(D, o))
    )
    # As listed where that is as good: nobody likes to visit in another order for nothing.
    if _length(D, order) >= (1 - _TRAVEL_TOLERANCE) * _length(D, listed):
        order = listed
    elif order[0] > order[-1]:
        order = order[::-1]
    return VisitingOrder(tuple(order), _length(D, order), _length(D, listed), len(Q) <= _MAX_EXACT_POSTURES)


def nearest_turns(robot: Robot, Q: Array, order: Sequence[int]) -> Array:
    """Postures (K, n) turned by whole turns within their limits, near the one visited before."""
    near = np.array(Q)
    turning = _turning(robot)
    for before, k in itertools.pairwise(order):
        wanted = np.rint((near[before] - near[k]) / TURN)
        least = np.ceil((robot.lower - near[k]) / TURN - 1e-9)
        most = np.floor((robot.upper - near[k]) / TURN + 1e-9)
        turns = np.where(turning & (least <= most), np.clip(wanted, least, most), 0.0)
        near[k] = np.clip(near[k] + turns * TURN, robot.lower, robot.upper)
    return near


def nearest_ties(robot: Robot, options: Sequence[Array]) -> list[int]:
    """Of each posture's equals (A_k, n) the one with which the tour is short; whole turns count as none."""
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
    Q = np.array([each[k] for each, k in zip(options, chosen, strict=True)])
    D = np.array([_apart(robot, Q, q) for q in Q])
    return min(_length(D, _nearest_first(D, first)) for first in range(len(Q)))


def _apart(robot: Robot, Q: Array, q: Array) -> Array:
    """(A,) largest difference of a joint between postures (A, n) and one (n,), whole turns taken off."""
    turns, away = _turning(robot), Q - q
    away = np.where(turns, away - TURN * np.rint(away / TURN), away)
    return np.asarray(np.abs(away[:, turns] if turns.any() else away).max(axis=1))


def _turning(robot: Robot) -> Mask:
    return np.array([joint.type == "revolute" for joint in robot.joints])


def _length(D: Array, order: Sequence[int]) -> float:
    return float(sum(D[a, b] for a, b in itertools.pairwise(order)))


def _held_karp(D: Array) -> list[int]:
    """Dynamic programming over subsets, O(2^K K²): M. Held and R. M. Karp, J. SIAM 10 (1962) 196."""
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


def _nearest_first(D: Array, first: int) -> list[int]:
    order, left = [first], set(range(len(D))) - {first}
    while left:
        order.append(min(left, key=lambda k: (D[order[-1], k], k)))
        left.remove(order[-1])
    return order


def _improved_tour(D: Array, order: list[int]) -> list[int]:
    better = True
    while better:
        better = False
        for i in range(len(order) - 1):
            for j in range(i + 1, len(order)):
                turned = [*order[:i], *order[i : j + 1][::-1], *order[j + 1 :]]
                if _length(D, turned) < _length(D, order) - 1e-9:
                    order, better = turned, True
    return order
