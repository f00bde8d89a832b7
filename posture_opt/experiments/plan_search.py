"""The choice of postures to measure, and how many random ones would do the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.experiments.candidate_postures import Workspace
from posture_opt.experiments.exchange import Criterion, exchange, inverse
from posture_opt.experiments.expected_errors import Unknowns
from posture_opt.experiments.information import MeasurementModel
from posture_opt.numerics import Array, Progress

_STARTS = 4  # of the exchange; fewer for large plans, where one ends as well as another
_STARTED = 240  # postures in all starts together
_NEW, _MOST_NEW = 24, 3000  # postures tried near each chosen one, and near all, in each round
_NEAR = (0.3, 0.1, 0.03)  # of the joints' ranges: how near, round by round
# Two postures differ by this in at least one joint [rad, m]: what the model cannot express differs from place to place.
_APART = {"revolute": np.radians(20.0), "prismatic": 0.05}
_SETTLED = 1e-10  # of the information of an average plan: with less in some direction something is open


@dataclass(frozen=True, eq=False)
class PlanSearch:
    """The choice of postures under one criterion."""

    measuring: MeasurementModel
    unknowns: Unknowns
    criterion: Criterion
    workspace: Workspace
    x: Array

    def best(self, pool: Array, J: Array, count: int, seed: int, progress: Progress | None) -> tuple[Array, Array]:
        """The best postures (count, n) and their derivatives: first of the pool, then also of others near them."""
        apart = self._apart(count)
        starts = max(1, min(_STARTS, _STARTED // count))
        start, total = self.unknowns.start, starts + len(_NEAR)

        def tell(done: int, _: int) -> None:
            if progress is not None:
                progress(done, total)

        found = exchange(
            self.unknowns.blocks(J), start, self.criterion, count, starts=starts, seed=seed, places=pool / apart,
            progress=tell,
        )  # fmt: skip
        q, chosen = pool[found.chosen], J[found.chosen]
        rng = np.random.default_rng(seed)
        for k, near in enumerate(_NEAR):
            others = self._near(q, near, rng)
            more = self.measuring.blocks(others, self.x)
            both, moves = np.concatenate([chosen, more]), np.concatenate([q, others])
            found = exchange(
                self.unknowns.blocks(both), start, self.criterion, count, former=np.arange(count), places=moves / apart
            )
            q, chosen = moves[found.chosen], both[found.chosen]
            tell(starts + k + 1, total)
        return q, chosen

    def _apart(self, count: int) -> Array:
        """(n,) two postures differ by more than this in at least one joint: a plan is no row of repeats."""
        workspace, n = self.workspace.upper - self.workspace.lower, self.workspace.robot.n
        stated = np.array([_APART[joint.type] for joint in self.workspace.robot.joints])
        return np.asarray(np.maximum(np.minimum(stated, workspace / (4 * count ** (1 / n))), 1e-9))

    def _near(self, q: Array, near: float, rng: np.random.Generator) -> Array:
        step = near * (self.workspace.upper - self.workspace.lower)
        tried = np.repeat(q, max(1, min(_NEW, _MOST_NEW // len(q))), axis=0)
        tried = self.workspace.rounded(tried + step * rng.normal(size=tried.shape))
        return np.asarray(tried[self.workspace.allowed(tried)])

    def value(self, J: Array) -> float:
        """The criterion of a plan; infinite where it leaves something open."""
        unknowns, flat = self.unknowns, self.unknowns.blocks(J).reshape(-1, self.unknowns.count)
        M = unknowns.T.T @ (unknowns.start + flat.T @ flat) @ unknowns.T
        values = np.linalg.eigvalsh(M)
        return self.criterion.transformed(unknowns.T).value(inverse(M)) if values[0] > _SETTLED else np.inf

    def compared(self, chosen: Array, random: list[Array]) -> tuple[int | None, float]:
        """How many random postures do the same (median), and how much larger the standard error of as many is.

        ``random`` are the derivatives (N, b, k) of random postures, in several orders.
        """
        best = self.value(chosen)
        sizes = [self._enough(drawn, best) for drawn in random]
        middle = float(np.median(sizes))
        same = float(np.median([self.value(drawn[: len(chosen)]) for drawn in random]))
        logs = self.criterion.logarithmic
        gain = np.exp((same - best) / (2 * self.unknowns.count)) if logs else np.sqrt(same / best)
        return (round(middle) if np.isfinite(middle) else None), float(gain)

    def _enough(self, drawn: Array, best: float) -> float:
        """How many of the first ``drawn`` postures are as good as ``best``, at least; infinite where all are not."""
        low, high = 0, len(drawn)
        if self.value(drawn) > best:
            return np.inf
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.value(drawn[:middle]) <= best else (middle, high)
        return float(high)
