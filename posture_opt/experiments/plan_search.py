"""The choice of postures to measure, how many random ones would do the same, and the order of the tour.

The choice is an exact design problem: the best ``count`` of some thousand candidates by exchange (Fedorov 1972), then
refined in shrinking neighbourhoods of the chosen postures, as the criterion is smooth in the joint values.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from posture_opt.experiments.candidate_postures import Workspace
from posture_opt.experiments.exchange import Criterion, exchange_design, inverse_matrix
from posture_opt.experiments.expected_errors import Unknowns
from posture_opt.experiments.information import MeasurementModel
from posture_opt.numerics import Array, Codes, Mask, Progress
from posture_opt.workers import Workers

_MAX_STARTS = 4  # of the exchange; fewer for large plans, where one ends as well as another
_MAX_STARTED_POSTURES = 240  # postures in all starts together
_NEW_PER_POSTURE, _MAX_NEW_POSTURES = 24, 3000  # postures tried near each chosen one, and near all, in each round
_NEIGHBOURHOODS = (0.3, 0.1, 0.03)  # of the joints' ranges: how near, round by round
_INFORMATION_TOLERANCE = 1e-10  # of the information of an average plan: with less in some direction something is open
_LEG_POINTS = 9  # along each leg that are looked at
_DENSE_STEP_RAD = np.radians(1.0)  # of the joint that moves most, along a leg that is taken
_MAX_TOURS = 8  # that are sought without legs that are found to be blocked
_BLOCKED_LEG_TURNS = 10.0  # turns that a leg through something counts for
_MAX_PASSES = 60  # of reversing parts of the tour


@dataclass(frozen=True, eq=False)
class PlanSearch:
    """The choice of postures under one criterion.

    Args:
        measuring: the measurement at a posture; ``unknowns`` what it is to determine.
        criterion: what a plan makes small, of the covariance of the unknowns.
        workspace: where postures may be.
        x: (k,) deviations from nominal [rad, m] at which everything is linearised.
    """

    measuring: MeasurementModel
    unknowns: Unknowns
    criterion: Criterion
    workspace: Workspace
    x: Array

    def best(
        self, pool: Array, J: Array, count: int, seed: int, workers: Workers, progress: Progress | None
    ) -> tuple[Array, Array]:
        """The best postures (count, n) [rad or m] and their derivatives (count, b, k).

        Args:
            pool: (N, n) allowed postures; J: (N, b, k) whitened derivatives there.
            seed: of the starts and of the neighbourhoods.
        """
        apart = self.workspace.separations(count)
        starts = max(1, min(_MAX_STARTS, _MAX_STARTED_POSTURES // count))
        start, total = self.unknowns.start, starts + len(_NEIGHBOURHOODS)

        def report_step(done: int, _: int) -> None:
            if progress is not None:
                progress(done, total)

        found = exchange_design(
            self.unknowns.blocks(J), start, self.criterion, count, starts=starts, seed=seed, places=pool / apart,
            workers=workers, progress=report_step,
        )  # fmt: skip
        q, chosen = pool[found.chosen], J[found.chosen]
        rng = np.random.default_rng(seed)
        for k, near in enumerate(_NEIGHBOURHOODS):
            others = self._nearby_postures(q, near, rng)
            more = self.measuring.blocks(others, self.x)
            both, moves = np.concatenate([chosen, more]), np.concatenate([q, others])
            found = exchange_design(
                self.unknowns.blocks(both), start, self.criterion, count, former=np.arange(count), places=moves / apart
            )
            q, chosen = moves[found.chosen], both[found.chosen]
            report_step(starts + k + 1, total)
        return q, chosen

    def _nearby_postures(self, q: Array, near: float, rng: np.random.Generator) -> Array:
        """Allowed postures (M, n) near those of a plan: Gaussian steps of ``near`` times each joint's range."""
        step = near * self.workspace.steps()
        tried = np.repeat(q, max(1, min(_NEW_PER_POSTURE, _MAX_NEW_POSTURES // len(q))), axis=0)
        tried = self.workspace.rounded(tried + step * rng.normal(size=tried.shape))
        return np.asarray(tried[self.workspace.allowed(tried)])

    def value(self, J: Array) -> float:
        """The criterion of a plan; infinite where it leaves something open."""
        unknowns, flat = self.unknowns, self.unknowns.blocks(J).reshape(-1, self.unknowns.count)
        M = unknowns.T.T @ (unknowns.start + flat.T @ flat) @ unknowns.T
        values = np.linalg.eigvalsh(M)
        return (
            self.criterion.transformed(unknowns.T).value(inverse_matrix(M))
            if values[0] > _INFORMATION_TOLERANCE
            else np.inf
        )

    def compared(self, chosen: Array, random: list[Array]) -> tuple[int | None, float]:
        """How many random postures do the same, and how much larger the standard error of as many random ones is.

        Medians.

        The ratio of standard errors is ``exp((v_r − v) / 2r)`` for the logarithm of a determinant over r unknowns, and
        ``√(v_r / v)`` for a variance.

        Args:
            chosen: (count, b, k) derivatives of the plan; random: (N, b, k) of random postures, in several orders.

        Returns:
            None in place of the number where all random postures together are worse than the plan.
        """
        best = self.value(chosen)
        sizes = [self._equivalent_count(drawn, best) for drawn in random]
        middle = float(np.median(sizes))
        same = float(np.median([self.value(drawn[: len(chosen)]) for drawn in random]))
        logs = self.criterion.logarithmic
        gain = np.exp((same - best) / (2 * self.unknowns.count)) if logs else np.sqrt(same / best)
        return (round(middle) if np.isfinite(middle) else None), float(gain)

    def _equivalent_count(self, drawn: Array, best: float) -> float:
        """How many of the first ``drawn`` postures are as good as ``best``, at least; infinite where all are not."""
        low, high = 0, len(drawn)
        if self.value(drawn) > best:
            return np.inf
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.value(drawn[:middle]) <= best else (middle, high)
        return float(high)


@dataclass(frozen=True, eq=False)
class Tour:
    """Postures in the order of the tour.

    A tour is open: it begins at the first posture and does not return.

    Args:
        order: (N,) indices of the postures.
        travel: sum over the legs of the largest joint move [rad], as the tour goes and as the postures came.
        blocked: legs (counted from 0, leg k leads to the posture k + 1 of the tour) that a straight move in joint
            space leads through what is not allowed.
        sides: (n,) share of the legs on which each joint arrives with increasing values.
        back: whether such a move from the last posture to the first is blocked, as of a further round.
    """

    order: Codes
    travel: float
    unordered: float
    blocked: tuple[int, ...]
    sides: Array
    back: bool = False


def shortest_tour(q: Array, lengths: Array, allowed: Callable[[Array], Mask]) -> Tour:
    """A short way through postures (N, n): nearest neighbour, then 2-opt (Croes 1958).

    A leg costs the largest joint motion; one that leads through what is not allowed costs ten turns more, so that it is
    taken only where there is no other. The start is the first posture.

    Args:
        q: (N, n) postures [rad or m].
        lengths: (n,) joint travel that counts as one radian: 1 for revolute joints, an arm's length for slides.
        allowed: which postures (M, n) may be passed through.

    Example:
        >>> import numpy as np
        >>> q = np.array([[0.0], [2.0], [1.0]])
        >>> way = shortest_tour(q, np.ones(1), lambda q: np.ones(len(q), dtype=bool))
        >>> way.order.tolist(), way.travel, way.unordered
        ([0, 2, 1], 2.0, 3.0)
    """
    n = len(q)
    if n < 2:
        return Tour(np.arange(n), 0.0, 0.0, (), np.full(q.shape[1], np.nan))
    far = np.abs(q[:, None] - q[None]) / lengths
    distance = far.max(axis=2)
    through = _blocked_moves(q, allowed)
    for _ in range(_MAX_TOURS):  # legs that are taken are looked at again, densely
        cost = distance + 2 * np.pi * _BLOCKED_LEG_TURNS * through
        order = _two_opt(_nearest_neighbours(cost), cost)
        a, b = order[:-1], order[1:]
        missed = ~through[a, b] & _blocked_legs(q[a], q[b], lengths, allowed)
        through[a, b] |= missed
        through[b, a] |= missed
        if not missed.any():
            break
    back = bool(_blocked_legs(q[order[-1:]], q[order[:1]], lengths, allowed)[0])
    moves = q[b] - q[a]
    with np.errstate(invalid="ignore"):
        sides = np.sum(moves > 0, axis=0) / np.sum(moves != 0, axis=0)
    blocked = tuple(int(k) for k in np.flatnonzero(through[a, b]))
    unordered = distance[np.arange(n - 1), np.arange(1, n)]
    return Tour(order, float(distance[a, b].sum()), float(unordered.sum()), blocked, sides, back)


def _blocked_legs(start: Array, end: Array, lengths: Array, allowed: Callable[[Array], Mask]) -> Mask:
    """(N,) whether straight moves from postures to others (N, n) lead through what is not allowed.

    Postures every `_DENSE_STEP_RAD` of the joint that moves most are looked at.
    """
    most = float((np.abs(end - start) / lengths).max(initial=0.0))
    shares = np.linspace(0, 1, math.ceil(most / _DENSE_STEP_RAD) + 2)[1:-1]
    every = start[:, None] + shares[:, None] * (end - start)[:, None]
    return np.asarray(~allowed(every.reshape(-1, start.shape[1])).reshape(len(start), -1).all(axis=1))


def _blocked_moves(q: Array, allowed: Callable[[Array], Mask]) -> Mask:
    """(N, N) whether the straight move between two postures leads through what is not allowed.

    `_LEG_POINTS` postures between the two are looked at, evenly spaced in the joint values: enough to find a way, and
    too few to be sure of it.
    """
    n = len(q)
    i, j = np.triu_indices(n, 1)
    free = np.ones(len(i), dtype=bool)
    for share in np.linspace(0, 1, _LEG_POINTS + 2)[1:-1]:
        free &= allowed((1 - share) * q[i] + share * q[j])
    through = np.zeros((n, n), dtype=bool)
    through[i, j] = through[j, i] = ~free
    return through


def _nearest_neighbours(cost: Array) -> Codes:
    """From posture 0, always on to the nearest that is left."""
    left = cost.copy()
    order = [0]
    for _ in range(len(cost) - 1):
        left[:, order[-1]] = np.inf
        order.append(int(np.argmin(left[order[-1]])))
    return np.array(order, dtype=np.intp)


def _two_opt(order: Codes, cost: Array) -> Codes:
    """The open tour with parts reversed, the best reversal of each start first, until none shortens it.

    Only the two legs at the ends of a reversed part change; all ends of one start are compared at once.
    """
    n = len(order)
    for _ in range(_MAX_PASSES):
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
