"""Orthogonal matching pursuit: the candidates that explain residuals, one after another, out of a whole dictionary.

Sources: Chen, Billings, Luo (1989), orthogonal least squares; Pati, Rezaiifar, Krishnaprasad (1993); Mamandipoor,
Ramasamy, Madhow (2016), who fit the frequencies of all lines after each step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.scores.score_tests import beyond_limits, fitted_sizes, orthonormal_basis
from posture_opt.diagnosis.search.dictionary import Atoms, Dictionary
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.diagnosis.search.selection_criterion import price_of_parameters
from posture_opt.diagnosis.search.shape_refinement import sharpen_lines
from posture_opt.model.effects import CyclicError
from posture_opt.numerics import Array, Codes, Mask

_RIDGE_SHARE = 1e-10  # of columns of length one: what depends on others keeps an inverse
_MAX_EXPLAINED = 1 - 1e-9  # of a sum of squares: all of it would have no logarithm
_RUNNERS_UP_PER_KIND = 4  # of atoms of a kind at each step: neighbours on a grid say the same


@dataclass(frozen=True, eq=False)
class Pursued:
    """What a pursuit chose, in its order, and at each step the candidates that would have done nearly as well.

    Runners-up are those within `levels.RIVAL_CRITERION` of the best at their step.
    """

    chosen: tuple[Candidate, ...]
    runners_up: tuple[Candidate, ...]


def pursue_candidates(dictionary: Dictionary, most: int, held_out: Codes | None = None) -> Pursued:
    """The candidates that lower the criterion ``m log RSS + prices`` most, one after another, until none does.

    A parameter is charged `price_of_parameters`, a candidate `price_of_choice`. The cost of a step is one product of
    all columns with the new directions; nothing is factorised again.

    Args:
        most: candidates at which it ends.
        held_out: rows that teach nothing.
    """
    linearised = dictionary.linearised
    residuals = linearised.sensitivities.residuals
    learn = np.ones(len(linearised.r), dtype=bool)
    if held_out is not None:
        learn[(held_out[:, None] * residuals.block + np.arange(residuals.block)).ravel()] = False
    Q, e = _projected_residuals(linearised, (), learn)
    freedom = float(learn.sum() - Q.shape[1])
    states = [_State(atoms, Q, e, held_out) for atoms in dictionary.atoms]
    chosen, runners_up, rss = list[Candidate](), list[Candidate](), float(e @ e)
    together = levels.MAX_EXCHANGED_EFFECTS if len(learn) <= levels.MAX_LINE_FIT_RESIDUALS else 0
    while len(chosen) < most and freedom >= 1 and rss > 0:  # else there is nothing left to explain
        drops = [state.drops(rss, freedom) for state in states]
        most_of_all = max((float(d.max(initial=0.0)) for d in drops), default=0.0)
        if most_of_all <= 0.0:
            break
        best = next(b for b, d in enumerate(drops) if d.max(initial=0.0) == most_of_all)
        within = most_of_all - levels.RIVAL_CRITERION
        if held_out is None:
            runners_up += [c for s, d in zip(states, drops, strict=True) for c in s.leading(d, max(within, 0.0))]
        candidate = _finest_shape(states[best].atoms, int(np.argmax(drops[best])), Q, e, learn)
        q = _new_directions(candidate, Q, learn)
        if not q.shape[1]:
            states[best].closed[int(np.argmax(drops[best]))] = True
            continue
        chosen.append(candidate)
        if isinstance(candidate.what, CyclicError) and together >= len(chosen):
            chosen = sharpen_lines(linearised, chosen, learn)
            Q, e = _projected_residuals(linearised, chosen, learn)
            states = [_State(atoms, Q, e, held_out, chosen) for atoms in dictionary.atoms]
        else:
            explained = q.T @ e
            e, Q = e - q @ explained, np.concatenate([Q, q], axis=1)
            for state in states:
                state.project(q, explained, candidate)
        rss = float(e @ e)
    return Pursued(tuple(chosen), tuple(runners_up))


def _projected_residuals(linearised: LinearisedData, chosen: Sequence[Candidate], learn: Mask) -> tuple[Array, Array]:
    """An orthonormal basis of geometry and chosen candidates on the rows that teach, and what it leaves of them.

    Returns:
        Q (m, p), zero in the rows left out, and e (m,).
    """
    columns = np.concatenate([linearised.G, *(c.Z for c in chosen)], axis=1) * learn[:, None]
    Q = np.where(learn[:, None], orthonormal_basis(columns), 0.0)
    e = linearised.r * learn
    return Q, e - Q @ (Q.T @ e)


class _State:
    """Atoms given what was chosen: Gram matrices and scores of their columns, projected off it, of length one.

    Args:
        atoms: n candidates of k columns; Q: (m, p) basis of what was chosen; e: (m,) what it leaves.
        held_out: rows that are left out; chosen: the candidates, of which other shapes are closed.
    """

    def __init__(
        self, atoms: Atoms, Q: Array, e: Array, held_out: Codes | None, chosen: Sequence[Candidate] = ()
    ) -> None:
        self.atoms = atoms
        gram = atoms.grams() if held_out is None else atoms.grams() - atoms.grams(held_out)
        norms = np.sqrt(np.maximum(np.einsum("ikk->ik", gram), 1e-300))
        self.scale = np.where(norms > 1e-12 * norms.max(initial=0.0), 1 / norms, 0.0)
        self.gram = gram * self.scale[:, :, None] * self.scale[:, None, :]
        self.score = atoms.products(e[:, None])[:, :, 0] * self.scale
        self.closed = np.zeros(len(gram), dtype=bool)
        for candidate in chosen:
            self.closed[atoms.excluded(candidate)] = True
        self._subtract(Q)

    def project(self, q: Array, explained: Array, chosen: Candidate) -> None:
        """Takes the new directions q (m, p) and what they explain off the columns."""
        self.score = self.score - self._subtract(q) @ explained
        self.closed[self.atoms.excluded(chosen)] = True

    def _subtract(self, q: Array) -> Array:
        """Takes directions q (m, p) off the Gram matrices; returns the inner products (n, k, p) with the columns."""
        inner = self.atoms.products(q) * self.scale[:, :, None]
        self.gram = self.gram - inner @ np.swapaxes(inner, 1, 2)
        return np.asarray(inner)

    def drops(self, rss: float, freedom: float) -> Array:
        """(n,) by how much each candidate would lower the criterion; minus infinity for one that cannot be."""
        gain, count = _explained_squares(*_principal_scores(self.gram, self.score))
        gain = np.minimum(gain, _MAX_EXPLAINED * rss)
        prices = price_of_parameters(count, gain / (rss / freedom), freedom) + self.atoms.prices
        drop = -freedom * np.log1p(-gain / rss) - prices
        impossible = self._impossible(rss / freedom) | (gain > self.atoms.most)
        return np.asarray(np.where(self.closed | (gain <= 0) | impossible, -np.inf, drop))

    def _impossible(self, variance: float) -> Mask:
        """(n,) whether the estimate of a parameter is beyond its physical limits."""
        if self.score.shape[1] == 1:
            size = -self.score[:, 0] / np.maximum(self.gram[:, 0, 0], 1e-300) * self.scale[:, 0]
            out: Mask = (size < self.atoms.limits[:, 0]) | (size > self.atoms.limits[:, 1])
            return out
        out = np.zeros(len(self.score), dtype=bool)
        for i in np.flatnonzero(np.any(np.isfinite(self.atoms.limits), axis=1)):
            scale = self.scale[i][:, None]
            sizes, errors = fitted_sizes(self.gram[i], self.score[i][:, None], variance)
            out[i] = bool(np.any(beyond_limits(sizes * scale, errors * scale, *self.atoms.limits[i])))
        return out

    def leading(self, drops: Array, least: float) -> list[Candidate]:
        """The few best candidates that are local maxima of the drop, at ``least`` or better."""
        before, behind = np.r_[-np.inf, drops[:-1]], np.r_[drops[1:], -np.inf]
        peaks = np.flatnonzero((drops >= least) & (drops >= before) & (drops >= behind))
        return [self.atoms.candidate(int(i)) for i in peaks[np.argsort(-drops[peaks])][:_RUNNERS_UP_PER_KIND]]


def _principal_scores(gram: Array, score: Array) -> tuple[Array, Array]:
    """Eigenvalues (n, k) of Gram matrices (n, k, k), and squares of the scores (n, k) along their eigenvectors.

    In closed form up to two columns, of which there are thousands.
    """
    if gram.shape[1] == 1:
        return gram[:, 0], score**2
    if gram.shape[1] > 2:
        values, vectors = np.linalg.eigh(gram)
        return values, np.einsum("ikl,ik->il", vectors, score) ** 2
    a, b, c = gram[:, 0, 0], gram[:, 0, 1], gram[:, 1, 1]
    half = np.hypot((a - c) / 2, b)
    angle = np.arctan2(2 * b, a - c) / 2
    x, y = np.cos(angle), np.sin(angle)
    values = np.stack([(a + c) / 2 + half, (a + c) / 2 - half], axis=1)
    along = np.stack([x * score[:, 0] + y * score[:, 1], x * score[:, 1] - y * score[:, 0]], axis=1)
    return values, along**2


def _finest_shape(atoms: Atoms, index: int, Q: Array, e: Array, learn: Array) -> Candidate:
    """The candidate between two neighbours on the grid that explains most."""
    best = _strongest_candidate(list(atoms.finer(index)), Q, e, learn)
    return _strongest_candidate(list(atoms.closer(best)), Q, e, learn)


def _strongest_candidate(finer: Sequence[Candidate], Q: Array, e: Array, learn: Array) -> Candidate:
    """That of some candidates of one width that explains most."""
    if len(finer) == 1:
        return finer[0]
    width = finer[0].Z.shape[1]
    Z = np.concatenate([c.Z for c in finer], axis=1) * learn[:, None]
    own = Z.reshape(len(Z), -1, width)
    gram = np.einsum("mik,mil->ikl", own, own, optimize=True)
    scale = 1 / np.sqrt(np.maximum(np.einsum("ikk->ik", gram), 1e-300))
    inner = (Z.T @ Q).reshape(-1, width, Q.shape[1])
    gram = (gram - inner @ np.swapaxes(inner, 1, 2)) * scale[:, :, None] * scale[:, None, :]
    gains = _explained_squares(*_principal_scores(gram, (Z.T @ e).reshape(-1, width) * scale))[0]
    return finer[int(np.argmax(gains))]


def _explained_squares(values: Array, parts: Array) -> tuple[Array, Array]:
    """(n,) what candidates explain along the eigenvectors that are new, and how many these are."""
    clear = values > levels.MIN_DISTINCT_SHARE
    return np.sum(np.where(clear, parts / np.maximum(values, levels.MIN_DISTINCT_SHARE), 0.0), axis=1), clear.sum(
        axis=1
    )


def _new_directions(candidate: Candidate, Q: Array, learn: Array) -> Array:
    """Orthonormal directions (m, p) that a candidate's columns add to Q on the rows that are fitted.

    Directions of which less than `levels.MIN_DISTINCT_SHARE` is new are left out.
    """
    Z = candidate.Z * learn[:, None]
    norms = np.linalg.norm(Z, axis=0)
    Z = Z / np.where(norms > 0, norms, 1.0)
    rest = Z - Q @ (Q.T @ Z)
    rest = rest - Q @ (Q.T @ rest)
    U, s, _ = np.linalg.svd(rest, full_matrices=False)
    return np.asarray(U[:, s**2 > levels.MIN_DISTINCT_SHARE])


@dataclass(frozen=True, eq=False)
class Subset:
    """Some members of a set, and the coefficients of all columns: those known first, zero for who is no member."""

    members: tuple[int, ...]
    coefficients: Array


def nested_subsets(columns: Sequence[Array], known: Array, r: Array) -> list[Subset]:
    """Subsets of every size of members, each without the one whose loss costs least: backward elimination.

    The inverse of the normal matrix is downdated at every removal, so that all subsets cost about one inversion.

    Args:
        columns: each (m, k) of one member; known: (m, g) what is always fitted to r (m,).

    Returns:
        From the empty set to that of all members.
    """
    sizes = [Z.shape[1] for Z in columns]
    A = np.concatenate([known, *columns], axis=1)
    norms = np.linalg.norm(A, axis=0)
    scale = np.where(norms > 0, 1 / np.where(norms > 0, norms, 1.0), 0.0)
    A = A * scale
    edges = np.cumsum([known.shape[1], *sizes])
    places = [np.arange(a, b) for a, b in pairwise(edges)]
    C = np.linalg.inv(A.T @ A + _RIDGE_SHARE * np.eye(A.shape[1]))
    theta = C @ (A.T @ r)
    kept, found = list(range(len(columns))), list[Subset]()
    while True:
        found.append(Subset(tuple(kept), theta * scale))
        if not kept:
            return found[::-1]
        gone = min(kept, key=lambda i: _wald_cost(C, theta, places[i]))
        own = places[gone]
        # The inverse of what is left of the Gram matrix, by the Schur complement.
        share = np.linalg.solve(C[np.ix_(own, own)], C[own]).T
        C, theta = C - share @ C[own], theta - share @ theta[own]
        theta[own] = 0.0
        kept.remove(gone)


def _wald_cost(C: Array, theta: Array, own: Codes) -> float:
    """Rise of the sum of squares without some of the parameters: ``θᵀ C⁻¹ θ`` (Wald)."""
    return float(theta[own] @ np.linalg.solve(C[np.ix_(own, own)], theta[own]))
