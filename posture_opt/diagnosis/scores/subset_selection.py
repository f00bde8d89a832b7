"""The set of candidates that explains residuals best, by exchange or elimination over Gram matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.score_tests import ProjectedColumns, unit_columns
from posture_opt.numerics import Array, Codes, Mask

Chosen = tuple[int, ...]


def explained_squares(gram: Array, score: Array) -> tuple[Array, Array]:
    """(n,) what candidates explain along the eigenvectors that are new, and how many these are.

    Args:
        gram: (n, k, k) of columns of former length one, projected off what was chosen; score: (n, k).
    """
    least = levels.MIN_DISTINCT_SHARE
    if gram.shape[1] == 1:
        value = gram[:, 0, 0]
        return np.where(value > least, score[:, 0] ** 2 / np.maximum(value, least), 0.0), (value > least).astype(int)
    if gram.shape[1] == 2:
        return _explained_by_pairs(gram, score)
    values, vectors = np.linalg.eigh(gram)
    parts = np.einsum("ikl,ik->il", vectors, score) ** 2
    clear = values > least
    return np.sum(np.where(clear, parts / np.maximum(values, least), 0.0), axis=1), clear.sum(axis=1)


def _explained_by_pairs(gram: Array, score: Array) -> tuple[Array, Array]:
    """`explained_squares` of two columns each, of which there are thousands, without their eigenvectors.

    ``sᵀ G⁻¹ s`` where both eigenvalues λ ≥ μ of G are clear, and ``sᵀ (G − μ) s / (λ (λ − μ))`` where λ alone is.
    """
    a, b, c = gram[:, 0, 0], gram[:, 0, 1], gram[:, 1, 1]
    x, y = score[:, 0], score[:, 1]
    middle, half = (a + c) / 2, np.hypot((a - c) / 2, b)
    first, second = middle + half > levels.MIN_DISTINCT_SHARE, middle - half > levels.MIN_DISTINCT_SHARE
    low = np.where(second, 0.0, middle - half)
    # Both at once: the inverse has the entries of the matrix turned by a right angle.
    squares = np.where(second, (a * y - b * x) * y + (c * x - b * y) * x, (a - low) * x**2 + (c - low) * y**2)
    squares = np.where(second, squares, squares + 2 * b * x * y)
    lengths = np.where(second, a * c - b * b, (middle + half) * 2 * half)
    return np.where(first, squares / np.where(first, lengths, 1.0), 0.0), first.astype(int) + second


def row_products(rows: Array) -> Array:
    """(…, k, k) inner products of the rows of many small matrices (…, k, w); written out for the narrow ones."""
    k, width = rows.shape[-2:]
    if k > 2:
        return np.asarray(rows @ np.swapaxes(rows, -1, -2))
    found = np.empty((*rows.shape[:-1], k))
    for a in range(k):
        for b in range(a + 1):
            found[..., a, b] = sum(rows[..., a, c] * rows[..., b, c] for c in range(width))
            found[..., b, a] = found[..., a, b]
    return found


def projected_gains(gram: Array, inner: Array, score: Array) -> Array:
    """(n,) what candidates explain of residuals, given a basis of what was chosen.

    Args:
        gram: (n, k, k) inner products of the columns of each, of any lengths.
        inner: (n, k, p) those with the basis; score: (n, k) those with the residuals that it leaves.
    """
    scale = 1 / np.sqrt(np.maximum(np.einsum("ikk->ik", gram), 1e-300))
    rest = (gram - inner @ np.swapaxes(inner, 1, 2)) * scale[:, :, None] * scale[:, None, :]
    return explained_squares(rest, score * scale)[0]


@dataclass(frozen=True, eq=False)
class Subset:
    """Some members of a set, and the coefficients of all columns: those known first, zero for who is no member."""

    members: tuple[int, ...]
    coefficients: Array


def nested_subsets(columns: Sequence[Array], known: Array, r: Array, learn: Mask | None = None) -> list[Subset]:
    """Subsets of every size of members, each without the one whose loss costs least: backward elimination.

    Args:
        columns: each (m, k) of one member; known: (m, g) what is always fitted to r (m,).
        learn: (m,) the rows that teach; all if None.
    """
    A, scale = unit_columns(np.concatenate([known, *columns], axis=1), learn)
    edges = np.cumsum([known.shape[1], *(Z.shape[1] for Z in columns)])
    places = [np.arange(a, b) for a, b in pairwise(edges)]
    C: Array = np.asarray(np.linalg.inv(A.T @ A + 1e-10 * np.eye(A.shape[1])))  # what depends on others keeps one
    theta = C @ (A.T @ r)
    kept, found = list(range(len(columns))), list[Subset]()
    while True:
        found.append(Subset(tuple(kept), theta * scale))
        if not kept:
            return found[::-1]
        gone = kept[int(np.argmin(_wald_costs(C, theta, [places[i] for i in kept])))]
        own = places[gone]
        # The inverse of what is left of the Gram matrix, by the Schur complement.
        share = np.linalg.solve(C[np.ix_(own, own)], C[own]).T
        C, theta = C - share @ C[own], theta - share @ theta[own]
        theta[own] = 0.0
        kept.remove(gone)


def _wald_costs(C: Array, theta: Array, each: Sequence[Codes]) -> Array:
    """Rise of the sum of squares without each of some groups of parameters: ``θᵀ C⁻¹ θ`` (Wald)."""
    found, sizes = np.zeros(len(each)), np.array([len(own) for own in each])
    for size in np.unique(sizes):
        alike = np.flatnonzero(sizes == size)
        own = np.array([each[int(i)] for i in alike])
        block, part = C[own[:, :, None], own[:, None, :]], theta[own]
        found[alike] = np.einsum("ik,ik->i", part, np.linalg.solve(block, part[:, :, None])[:, :, 0])
    return found


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates by the inner products of their bases projected off the baseline, and the penalty of each.

    Args:
        penalty: (candidates,) added to the criterion for each chosen one: for its parameters, for a grid that was
            searched, for having no name.
        exclusive: (candidates,) candidates of equal code exclude each other.
        most: (candidates,) sum of squares that each can explain at the most; infinite where nothing limits it.
    """

    columns: ProjectedColumns
    rss0: float
    freedom: float
    penalty: Array
    exclusive: Codes
    most: Array

    def alike(self, one: int, other: int) -> float:
        """The largest cosine between a direction of one candidate and one of another."""
        edges = self.columns.edges
        between = self.columns.gram[edges[one] : edges[one + 1], edges[other] : edges[other + 1]]
        return float(np.linalg.norm(between, 2))

    def _index(self, chosen: Chosen) -> Codes:
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
        return float(self.rss0 - b @ np.linalg.lstsq(G, b, rcond=1e-6)[0])

    def criterion(self, chosen: Chosen) -> float:
        """``m log(RSS/m) + Σ penalties``: the least is the best (Schwarz 1978)."""
        m, cost = self.freedom, sum(float(self.penalty[i]) for i in chosen)
        return float(m * np.log(max(self.rss(chosen), 1e-300) / m) + cost)

    def additions(self, chosen: Chosen) -> list[tuple[float, Chosen]]:
        """Every set with one candidate more, with its criterion, the best first."""
        return self.priced(chosen, *self.explained(chosen))

    def explained(self, chosen: Chosen) -> tuple[Codes, Array]:
        """Candidates (n,) beside a set, and the the sums of squares (n,) left by both together.

        The gain of a candidate is ``Σ (vᵀ b)² / λ`` over the eigenvectors v of its Gram matrix given the set, those
        only that are new by `levels.MIN_DISTINCT_SHARE`.
        """
        index = self._index(chosen)
        G, b = self.columns.gram, self.columns.scores
        rss = self.rss0
        cross, left = G[:0], b
        if chosen:
            inverse = np.linalg.pinv(G[np.ix_(index, index)], rcond=1e-8)
            cross = inverse @ G[index]
            left = b - G[:, index] @ (inverse @ b[index])
            rss = float(rss - b[index] @ inverse @ b[index])
        open_ = np.flatnonzero(~np.isin(self.exclusive, self.exclusive[list(chosen)]))
        gains = self._gains(open_, index, cross, left)
        allowed = gains <= self.most[open_]
        return open_[allowed], rss - gains[allowed]

    def priced(self, chosen: Chosen, further: Codes, rss: Array) -> list[tuple[float, Chosen]]:
        """Sets with one candidate more, with their criterion by the penalties of this pool, the best first."""
        m, cost = self.freedom, sum(float(self.penalty[i]) for i in chosen)
        values = m * np.log(np.maximum(rss, 1e-300) / m) + cost + self.penalty[further]
        sets = (tuple(sorted((*chosen, i))) for i in further.tolist())
        return sorted(zip(values.tolist(), sets, strict=True))

    def _gains(self, candidates: Codes, index: Codes, cross: Array, left: Array) -> Array:
        """What candidates explain given the directions ``index`` (r,) of a set, those of one width together."""
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
    value = pool.criterion(chosen)
    while True:
        trials = []
        for i in chosen:
            rest = tuple(j for j in chosen if j != i)
            trials.append((pool.criterion(rest), rest))
            trials += pool.additions(rest)[:1]
        better = min(trials, default=(np.inf, chosen))
        if better[0] >= value - 1e-9:  # less is rounding, and an exchange could go in circles
            return chosen
        value, chosen = better


def close_alternatives(pools: Sequence[Pool], chosen: Chosen, member: int, within: float) -> list[tuple[float, int]]:
    """Candidates that could replace a member at a criterion at most ``within`` worse, those of each pool best first."""
    rest = tuple(j for j in chosen if j != member)
    beside, found = pools[0].explained(rest), list[tuple[float, int]]()
    for pool in pools:
        value = pool.criterion(chosen)
        near = [(other - value, bigger) for other, bigger in pool.priced(rest, *beside) if other <= value + within]
        found += [(more, next(i for i in bigger if i not in rest)) for more, bigger in near]
    return [(more, new) for more, new in found if new != member]
