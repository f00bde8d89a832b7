"""The set of candidates that explains residuals best, by exchange over their Gram matrix.

All that a comparison of sets needs are inner products of the candidates' orthonormal directions, which are taken once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from posture_opt.diagnosis.scores.projected_scores import explained_squares
from posture_opt.diagnosis.scores.score_tests import ProjectedColumns
from posture_opt.numerics import Array, Codes

Chosen = tuple[int, ...]

_RANK_TOLERANCE, _INVERSE_TOLERANCE = (
    1e-6,
    1e-8,
)  # of the largest eigenvalue of a Gram matrix: linear dependence to rounding
_GAIN_TOLERANCE = 1e-9  # of the criterion: a smaller gain is rounding, and an exchange could go in circles


@dataclass(frozen=True, eq=False)
class Additions:
    """Candidates beside a chosen set, and the sum of squares (n,) that the set with each of them leaves."""

    chosen: Chosen
    further: Codes
    rss: Array


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates by the inner products of their bases projected off the baseline, and the penalty of each.

    Two shapes of one effect have equal codes: a set holds at most one of them.

    Args:
        columns: those inner products, with each other and with the residuals that the baseline leaves, of which
            ``rss0`` is the sum of squares with nothing chosen and ``freedom`` the (effective) degrees of freedom.
        penalty: (candidates,) added to the criterion for each chosen one: for its parameters, for a grid that was
            searched, for having no name.
        exclusive: (candidates,) candidates of equal code exclude each other.
        most: (candidates,) sum of squares that each can explain at the most; empty where nothing limits them.
    """

    columns: ProjectedColumns
    rss0: float
    freedom: float
    penalty: Array
    exclusive: Codes
    most: Array = field(default_factory=lambda: np.zeros(0))

    def alike(self, one: int, other: int) -> float:
        """The largest cosine between a direction of one candidate and one of another."""
        edges = self.columns.edges
        between = self.columns.gram[edges[one] : edges[one + 1], edges[other] : edges[other + 1]]
        return float(np.linalg.norm(between, 2))

    def _index(self, chosen: Chosen) -> Codes:
        """Indices of the directions of a set."""
        edges = self.columns.edges
        return np.concatenate([np.arange(edges[i], edges[i + 1]) for i in chosen]) if chosen else np.zeros(0, int)

    def rss(self, chosen: Chosen) -> float:
        """Sum of squares that a set leaves.

        ``rss0 − bᵀ G⁺ b`` with the Gram matrix G of its directions and their scores b.
        """
        if not chosen:
            return self.rss0
        index = self._index(chosen)
        G, b = self.columns.gram[np.ix_(index, index)], self.columns.scores[index]
        return float(self.rss0 - b @ np.linalg.lstsq(G, b, rcond=_RANK_TOLERANCE)[0])

    def criterion(self, chosen: Chosen) -> float:
        """``m log(RSS/m) + Σ penalties``: the least is the best (Schwarz 1978)."""
        return self._criterion(self.rss(chosen), chosen)

    def _criterion(self, rss: float, chosen: Chosen) -> float:
        """The criterion of a set whose sum of squares is known."""
        m = self.freedom
        cost = sum(float(self.penalty[i]) for i in chosen)
        return float(m * np.log(max(rss, 1e-300) / m) + cost)

    def additions(self, chosen: Chosen) -> list[tuple[float, Chosen]]:
        """Every set with one candidate more, with its criterion, the best first."""
        return self.priced(self.explained(chosen))

    def explained(self, chosen: Chosen) -> Additions:
        """What every further candidate explains beside a set, whatever it is charged.

        The gain of a candidate is ``Σ (vᵀ b)² / λ`` over the eigenvectors v of its Gram matrix given the set, those
        only that are new by `levels.MIN_DISTINCT_SHARE`.
        """
        taken = {int(self.exclusive[i]) for i in chosen}
        index = self._index(chosen)
        G, b = self.columns.gram, self.columns.scores
        rss = self.rss0
        cross, left = G[:0], b
        if chosen:
            inverse = np.linalg.pinv(G[np.ix_(index, index)], rcond=_INVERSE_TOLERANCE)
            cross = inverse @ G[index]
            left = b - G[:, index] @ (inverse @ b[index])
            rss = float(rss - b[index] @ inverse @ b[index])
        open_ = np.flatnonzero(~np.isin(self.exclusive, list(taken)))
        gains = self._gains(open_, index, cross, left)
        allowed = gains <= (self.most[open_] if len(self.most) else np.inf)
        return Additions(chosen, open_[allowed], rss - gains[allowed])

    def priced(self, found: Additions) -> list[tuple[float, Chosen]]:
        """Sets with one candidate more, with their criterion by the penalties of this pool, the best first."""
        m, cost = self.freedom, sum(float(self.penalty[i]) for i in found.chosen)
        values = m * np.log(np.maximum(found.rss, 1e-300) / m) + cost + self.penalty[found.further]
        sets = (tuple(sorted((*found.chosen, i))) for i in found.further.tolist())
        return sorted(zip(values.tolist(), sets, strict=True))

    def _gains(self, candidates: Codes, index: Codes, cross: Array, left: Array) -> Array:
        """What candidates explain given the directions ``index`` (r,) of a set, those of one width together.

        Args:
            cross: (r, R) ``G_ss⁺ G_s``; left: (R,) scores that the set leaves.
        """
        G, edges, sizes = self.columns.gram, self.columns.edges, self.columns.sizes[candidates]
        gains = np.zeros(len(candidates))
        for size in np.unique(sizes[sizes > 0]):
            alike = np.flatnonzero(sizes == size)
            own = edges[candidates[alike], None] + np.arange(size)
            block = G[own[:, :, None], own[:, None, :]]
            if len(index):
                block = block - G[own[:, :, None], index] @ np.moveaxis(cross[:, own], 0, 1)
            gains[alike] = explained_squares(block, left[own])[0]
        return gains


def exchange_members(pool: Pool, chosen: Chosen) -> Chosen:
    """Drops and swaps as long as the criterion falls.

    Args:
        chosen: indices of the set to begin with.

    Returns:
        A local minimum: no drop and no swap lowers the criterion.
    """
    value = pool.criterion(chosen)
    while True:
        trials = []
        for i in chosen:
            rest = tuple(j for j in chosen if j != i)
            trials.append((pool.criterion(rest), rest))
            trials += pool.additions(rest)[:1]
        better = min(trials, default=(np.inf, chosen))
        if better[0] >= value - _GAIN_TOLERANCE:
            return chosen
        value, chosen = better


def close_alternatives(pools: Sequence[Pool], chosen: Chosen, member: int, within: float) -> list[tuple[float, int]]:
    """Candidates that could replace a member at a criterion at most ``within`` worse, those of each pool best first.

    Args:
        pools: of the same candidates, with other penalties.

    Returns:
        (rise of the criterion, index) of each.
    """
    rest = tuple(j for j in chosen if j != member)
    beside = pools[0].explained(rest) if pools else None
    found = []
    for pool in pools:
        assert beside is not None
        value = pool.criterion(chosen)
        for other, bigger in pool.priced(beside):
            if other > value + within:
                break
            new = next(i for i in bigger if i not in rest)
            if new != member:
                found.append((other - value, new))
    return found
