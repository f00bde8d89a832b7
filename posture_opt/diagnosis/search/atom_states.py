"""``AtomStates``: what candidates are still worth to several pursuits that run side by side.

Pursuits that leave different rows out share all columns: one product of the columns serves every one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.scores.projected_scores import explained_squares, row_products
from posture_opt.diagnosis.scores.score_tests import beyond_limits, stacked_sizes
from posture_opt.diagnosis.search.atoms import Atoms
from posture_opt.diagnosis.search.selection_criterion import price_of_parameters
from posture_opt.numerics import Array, Codes, Mask

_MAX_EXPLAINED = 1 - 1e-9  # of a sum of squares: all of it would have no logarithm
_RUNNERS_UP_PER_KIND = 4  # of atoms of a kind at each step: neighbours on a grid say the same


@dataclass(frozen=True, eq=False)
class Taken:
    """What one pursuit took: a candidate, its new directions q (m, p), and what they explain (p,) of the residuals.

    Args:
        place: of the pursuit among those side by side.
    """

    place: int
    candidate: Candidate
    q: Array
    explained: Array


class AtomStates:
    """Gram matrices and scores of n candidates of k columns, projected off what each of F pursuits chose.

    Columns have length one in the rows that a pursuit learns from.

    Args:
        atoms: the candidates; held_out: rows that each pursuit leaves out, None for none.
    """

    def __init__(self, atoms: Atoms, held_out: Sequence[Codes | None]) -> None:
        self.atoms = atoms
        gram = atoms.grams(held_out)
        norms = np.sqrt(np.maximum(np.einsum("fikk->fik", gram), 1e-300))
        longest = norms.max(axis=(1, 2), keepdims=True, initial=0.0)
        self.scale: Array = np.where(norms > 1e-12 * longest, 1 / norms, 0.0)
        self._whole = gram * self.scale[:, :, :, None] * self.scale[:, :, None, :]
        self.gram: Array = self._whole.copy()
        self.score: Array = np.zeros(self.scale.shape)
        self.closed: Mask = np.zeros(self.scale.shape[:2], dtype=bool)

    def begin(self, place: int, Q: Array, e: Array, chosen: Sequence[Candidate] = ()) -> None:
        """The state of one pursuit from the basis Q (m, p) of what it chose, and what that leaves, e (m,)."""
        inner = self.atoms.products(np.concatenate([Q, e[:, None]], axis=1)) * self.scale[place][:, :, None]
        self.score[place], inner = inner[:, :, -1], inner[:, :, :-1]
        self.gram[place] = self._whole[place] - inner @ np.swapaxes(inner, 1, 2)
        self.closed[place] = False
        for candidate in chosen:
            self.closed[place, self.atoms.excluded(candidate)] = True

    def project(self, steps: Sequence[Taken]) -> None:
        """Takes the new directions of some pursuits, and what they explain, off the columns."""
        places = [step.place for step in steps]
        width = max(step.q.shape[1] for step in steps)
        rows, explained = np.zeros((len(steps), width, len(steps[0].q))), np.zeros((len(steps), width))
        for i, step in enumerate(steps):
            rows[i, : step.q.shape[1]], explained[i, : step.q.shape[1]] = step.q.T, step.explained
        products = self.atoms.products(rows.reshape(-1, rows.shape[2]).T)
        inner = np.moveaxis(products.reshape(*products.shape[:2], *explained.shape), 2, 0)
        inner = inner * self.scale[places][:, :, :, None]
        at = slice(None) if len(places) == len(self.gram) else places
        self.gram[at] -= row_products(inner)
        self.score[at] -= sum(inner[..., c] * explained[:, None, None, c] for c in range(width))
        for step in steps:
            self.closed[step.place, self.atoms.excluded(step.candidate)] = True

    def drops(self, places: Sequence[int], rss: Array, freedom: Array) -> Array:
        """(f, n) by how much each candidate would lower the criterion; minus infinity for one that cannot be.

        Args:
            places: of f pursuits; rss, freedom: (f,) what they leave, and its degrees of freedom.
        """
        at = slice(None) if len(places) == len(self.gram) else places
        gram, score = self.gram[at], self.score[at]
        flat = explained_squares(gram.reshape(-1, *gram.shape[2:]), score.reshape(-1, score.shape[2]))
        gain, count = (part.reshape(score.shape[:2]) for part in flat)
        rss, freedom = rss[:, None], freedom[:, None]
        gain = np.minimum(gain, _MAX_EXPLAINED * rss)
        prices = price_of_parameters(count, gain / (rss / freedom), freedom) + self.atoms.prices
        drop = -freedom * np.log1p(-gain / rss) - prices
        impossible = self._impossible(places, gram, score, rss / freedom) | (gain > self.atoms.most)
        return np.asarray(np.where(self.closed[places] | (gain <= 0) | impossible, -np.inf, drop))

    def _impossible(self, places: Sequence[int], gram: Array, score: Array, variance: Array) -> Mask:
        """(f, n) whether the estimate of a parameter is beyond its physical limits; variance: (f, 1)."""
        limits, scale = self.atoms.limits, self.scale[places]
        if score.shape[2] == 1:
            size = -score[:, :, 0] / np.maximum(gram[:, :, 0, 0], 1e-300) * scale[:, :, 0]
            out: Mask = (size < limits[:, 0]) | (size > limits[:, 1])
            return out
        out = np.zeros(score.shape[:2], dtype=bool)
        limited = np.flatnonzero(np.any(np.isfinite(limits), axis=1))
        if len(limited):
            sizes, errors = stacked_sizes(gram[:, limited], score[:, limited], variance)
            low, high = (limits[limited, end][None, :, None] for end in (0, 1))
            own = scale[:, limited]
            out[:, limited] = np.any(beyond_limits(sizes * own, errors * own, low, high), axis=2)
        return out

    def leading(self, drops: Array, least: float) -> list[Candidate]:
        """The few best candidates of each kind that are local maxima of the drop (n,), at ``least`` or better."""
        found = list[Candidate]()
        for first, end in pairwise(self.atoms.edges):
            own = drops[first:end]
            before, behind = np.r_[-np.inf, own[:-1]], np.r_[own[1:], -np.inf]
            peaks = np.flatnonzero((own >= least) & (own >= before) & (own >= behind))
            best = peaks[np.argsort(-own[peaks])][:_RUNNERS_UP_PER_KIND]
            found += [self.atoms.candidate(first + int(i)) for i in best]
        return found
