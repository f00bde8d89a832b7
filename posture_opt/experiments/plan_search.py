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
from posture_opt.experiments.information import MeasurementModel, Unknowns
from posture_opt.numerics import Array, Codes, Mask, Progress
from posture_opt.workers import Workers

_NEW_PER_POSTURE, _MAX_NEW_POSTURES = 24, 3000  # postures tried near each chosen one, and near all, in each round
_NEIGHBOURHOODS = (0.3, 0.1, 0.03)  # of the joints' ranges: how near, round by round
_DENSE_STEP_RAD = np.radians(1.0)  # of the joint that moves most, along a leg that is taken


@dataclass(frozen=True, eq=False)
class PlanSearch:
    """The choice of postures under one criterion."""

    measuring: MeasurementModel  # the measurement at a posture; ``unknowns`` what it is to determine
    unknowns: Unknowns
    criterion: Criterion  # what a plan makes small, of the covariance of the unknowns
    workspace: Workspace  # where postures may be
    x: Array  # (k,) deviations from nominal [rad, m] at which everything is linearised

    def best(
        self, pool: Array, J: Array, count: int, seed: int, workers: Workers, progress: Progress | None
    ) -> tuple[Array, Array]:
        """The best postures (count, n) [rad or m] and their derivatives (count, b, k).

        pool (N, n) allowed postures; J: (N, b, k) whitened derivatives there.
        """
        apart = self.workspace.separations(count)
        # 4 of the exchange; fewer for large plans, where one ends as well as another
        # 240 postures in all starts together
        starts = max(1, min(4, 240 // count))
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
            # Gaussian steps of a share of each joint's range.
            tried = np.repeat(q, max(1, min(_NEW_PER_POSTURE, _MAX_NEW_POSTURES // len(q))), axis=0)
            tried = self.workspace.rounded(tried + near * self.workspace.steps() * rng.normal(size=tried.shape))
            others = tried[self.workspace.allowed(tried)]
            more = self.measuring.blocks(others, self.x)
            both, moves = np.concatenate([chosen, more]), np.concatenate([q, others])
            found = exchange_design(
                self.unknowns.blocks(both), start, self.criterion, count, former=np.arange(count), places=moves / apart
            )
            q, chosen = moves[found.chosen], both[found.chosen]
            report_step(starts + k + 1, total)
        return q, chosen

    def value(self, J: Array) -> float:
        """The criterion of a plan; infinite where it leaves something open."""
        unknowns, flat = self.unknowns, self.unknowns.blocks(J).reshape(-1, self.unknowns.count)
        M = unknowns.T.T @ (unknowns.start + flat.T @ flat) @ unknowns.T
        # 1e-10 of the information of an average plan: with less in some direction something is open
        if np.linalg.eigvalsh(M)[0] <= 1e-10:
            return np.inf
        return self.criterion.transformed(unknowns.T).value(inverse_matrix(M))

    def compared(self, chosen: Array, random: list[Array]) -> tuple[int | None, float]:
        """How many random postures do the same, and how much larger the standard error of as many random ones is.

        The ratio of standard errors is ``exp((v_r − v) / 2r)`` for the logarithm of a determinant over r unknowns, and
        ``√(v_r / v)`` for a variance.

        chosen (count, b, k) derivatives of the plan; random: (N, b, k) of random postures, in several orders.
        """
        best, sizes = self.value(chosen), []
        for drawn in random:  # how many of the first are as good, by bisection
            low, high = 0, len(drawn)
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (low, middle) if self.value(drawn[:middle]) <= best else (middle, high)
            sizes.append(np.inf if self.value(drawn) > best else float(high))
        typical = float(np.median(sizes))
        same = float(np.median([self.value(drawn[: len(chosen)]) for drawn in random]))
        logs = self.criterion.logarithmic
        gain = np.exp((same - best) / (2 * self.unknowns.count)) if logs else np.sqrt(same / best)
        return (round(typical) if np.isfinite(typical) else None), float(gain)


@dataclass(frozen=True, eq=False)
class Tour:
    """Postures in the order of the tour."""

    order: Codes  # (N,) indices of the postures
    travel: float  # sum over the legs of the largest joint move [rad], as the tour goes and as the postures came
    unordered: float
    # legs (counted from 0, leg k leads to the posture k + 1 of the tour) that a straight move in joint space leads
    # through what is not allowed
    blocked: tuple[int, ...]
    sides: Array  # (n,) share of the legs on which each joint arrives with increasing values
    back: bool = False  # whether such a move from the last posture to the first is blocked, as of a further round


def shortest_tour(q: Array, lengths: Array, allowed: Callable[[Array], Mask]) -> Tour:
    """A short way through postures (N, n): nearest neighbour, then 2-opt (Croes 1958).

    q (N, n) postures [rad or m]; lengths (n,) joint travel that counts as one radian: 1 for revolute joints, an arm's
    length for slides; allowed: which postures (M, n) may be passed through.
    """
    n = len(q)
    if n < 2:
        return Tour(np.arange(n), 0.0, 0.0, (), np.full(q.shape[1], np.nan))
    far = np.abs(q[:, None] - q[None]) / lengths
    distance = far.max(axis=2)
    through = _blocked_moves(q, allowed)
    # 8 that are sought without legs that are found to be blocked
    for _ in range(8):  # legs that are taken are looked at again, densely
        # 10.0 turns that a leg through something counts for
        cost = distance + 2 * np.pi * 10.0 * through
        order = _two_opt(cost)
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
    """(N,) whether straight moves from postures to others (N, n) lead through what is not allowed."""
    most = float((np.abs(end - start) / lengths).max(initial=0.0))
    shares = np.linspace(0, 1, math.ceil(most / _DENSE_STEP_RAD) + 2)[1:-1]
    every = start[:, None] + shares[:, None] * (end - start)[:, None]
    return np.asarray(~allowed(every.reshape(-1, start.shape[1])).reshape(len(start), -1).all(axis=1))


def _blocked_moves(q: Array, allowed: Callable[[Array], Mask]) -> Mask:
    """(N, N) whether the straight move between two postures leads through what is not allowed."""
    n = len(q)
    i, j = np.triu_indices(n, 1)
    free = np.ones(len(i), dtype=bool)
    # 9 along each leg that are looked at
    for share in np.linspace(0, 1, 9 + 2)[1:-1]:
        free &= allowed((1 - share) * q[i] + share * q[j])
    through = np.zeros((n, n), dtype=bool)
    through[i, j] = through[j, i] = ~free
    return through


def _two_opt(cost: Array) -> Codes:
    """The open tour from posture 0 to the nearest left, then parts reversed, the best of each start first (Croes 1958).

    Only the two legs at the ends of a reversed part change; all ends of one start are compared at once.
    """
    n, left, tour = len(cost), cost.copy(), [0]
    for _ in range(n - 1):
        left[:, tour[-1]] = np.inf
        tour.append(int(np.argmin(left[tour[-1]])))
    order = np.array(tour, dtype=np.intp)
    for _ in range(60):  # passes
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
