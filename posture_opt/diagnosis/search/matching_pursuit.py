"""Orthogonal matching pursuit: the candidates that explain residuals, one after another, out of a whole dictionary.

Sources: Chen, Billings, Luo (1989), orthogonal least squares; Pati, Rezaiifar, Krishnaprasad (1993); Mamandipoor,
Ramasamy, Madhow (2016), who fit the frequencies of all lines after each step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from posture_opt.calibration.cross_validation import residual_indices
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate, LinearisedData
from posture_opt.diagnosis.scores.score_tests import beyond_limits, orthonormal_basis, stacked_sizes
from posture_opt.diagnosis.scores.subset_selection import explained_squares, row_products
from posture_opt.diagnosis.search.atoms import Atoms, Dictionary
from posture_opt.diagnosis.search.selection_criterion import price_of_parameters
from posture_opt.diagnosis.search.shape_refinement import sharpen_lines
from posture_opt.model.effects import CyclicError
from posture_opt.numerics import Array, Codes, Mask


@dataclass(frozen=True, eq=False)
class Taken:
    """What one pursuit took: a candidate, its new directions q (m, p), and what they explain (p,) of the residuals."""

    place: int
    candidate: Candidate
    q: Array
    explained: Array


class AtomStates:
    """Gram matrices and scores of n candidates of k columns, projected off what each of F pursuits chose."""

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
        gain = np.minimum(gain, (1 - 1e-9) * rss)  # all of it would have no logarithm
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
        """The four best candidates that are local maxima of the drop (n,), at ``least`` or better."""
        before, behind = np.r_[-np.inf, drops[:-1]], np.r_[drops[1:], -np.inf]
        peaks = np.flatnonzero((drops >= least) & (drops >= before) & (drops >= behind))
        return [self.atoms.candidate(int(i)) for i in peaks[np.argsort(-drops[peaks])][:4]]


@dataclass(frozen=True, eq=False)
class Pursued:
    """What a pursuit chose, in its order, and at each step the candidates that would have done nearly as well."""

    chosen: tuple[Candidate, ...]
    runners_up: tuple[Candidate, ...]


def pursue_candidates(dictionary: Dictionary, most: int) -> Pursued:
    """The candidates that lower the criterion ``m log RSS + prices`` most, one after another, until none does."""
    return _pursue_together(dictionary, most, [None])[0]


def pursue_in_folds(dictionary: Dictionary, most: int, folds: Sequence[Codes]) -> Iterator[Pursued]:
    """`pursue_candidates` without the rows of each fold, one after another, as many side by side as memory allows."""
    together = max(1, 160_000 // len(dictionary.linearised.r))  # bases of some 100 columns each in 130 MB
    for first in range(0, len(folds), together):
        yield from _pursue_together(dictionary, most, folds[first : first + together])


def _pursue_together(dictionary: Dictionary, most: int, held_out: Sequence[Codes | None]) -> list[Pursued]:
    linearised = dictionary.linearised
    pursuits = [_Pursuit(linearised, place, rows) for place, rows in enumerate(held_out)]
    states = [AtomStates(atoms, held_out) for atoms in dictionary.atoms]
    for one, state in product(pursuits, states):
        state.begin(one.place, one.Q, one.e)
    while going := [one for one in pursuits if one.goes_on and len(one.chosen) < most]:
        places, rss, freedom = ([getattr(one, name) for one in going] for name in ("place", "rss", "freedom"))
        drops = [state.drops(places, np.array(rss), np.array(freedom)) for state in states]
        steps = [step for i, one in enumerate(going) if (step := one.take_best(states, [d[i] for d in drops]))]
        for state in states if steps else ():
            state.project(steps)
    return [Pursued(tuple(one.chosen), tuple(one.runners_up)) for one in pursuits]


class _Pursuit:
    def __init__(self, linearised: LinearisedData, place: int, held_out: Codes | None) -> None:
        self.place = place
        self._linearised, self._whole = linearised, held_out is None
        self.learn: Mask = np.ones(len(linearised.r), dtype=bool)
        if held_out is not None:
            self.learn[residual_indices(held_out, linearised.sensitivities.residuals.block)] = False
        self._compact = not self._whole and len(linearised.sensitivities.residuals.data) >= levels.MANY_ROWS
        self.Q, self.e = _projected_residuals(linearised, (), self.learn)
        self.freedom = float(self.learn.sum() - self.Q.shape[1])
        self.chosen, self.runners_up = list[Candidate](), list[Candidate]()
        self._ended = False
        self._together = levels.MAX_EXCHANGED_EFFECTS if len(self.learn) <= levels.MANY_RESIDUALS else 0

    @property
    def rss(self) -> float:
        return float(self.e @ self.e)

    @property
    def goes_on(self) -> bool:
        return not self._ended and self.freedom >= 1 and self.rss > 0

    def take_best(self, states: Sequence[AtomStates], drops: Sequence[Array]) -> Taken | None:
        """Takes the candidate that lowers the criterion most; the caller of what it returns gets the states.

        Args:
            drops: (n,) of the atoms of each state.
        """
        most_of_all = max((float(d.max(initial=0.0)) for d in drops), default=0.0)
        self._ended = most_of_all <= 0.0
        if self._ended:
            return None
        best = next(b for b, d in enumerate(drops) if d.max(initial=0.0) == most_of_all)
        index = int(np.argmax(drops[best]))
        if self._whole:
            within = max(most_of_all - levels.RIVAL_CRITERION, 0.0)
            self.runners_up += [c for s, d in zip(states, drops, strict=True) for c in s.leading(d, within)]
        candidate = states[best].atoms.finest(index, self.Q, self.e, self.learn)
        q = _new_directions(candidate, self.Q, self.learn)
        if not q.shape[1]:
            states[best].closed[self.place, index] = True
            return None
        if self._compact:  # in single precision, as those of a dictionary of many rows are
            candidate = replace(candidate, Z=candidate.Z.astype(np.float32, copy=False))
        self.chosen.append(candidate)
        if isinstance(candidate.what, CyclicError) and self._together >= len(self.chosen):
            self.chosen = sharpen_lines(self._linearised, self.chosen, self.learn)
            self.Q, self.e = _projected_residuals(self._linearised, self.chosen, self.learn)
            for state in states:
                state.begin(self.place, self.Q, self.e, self.chosen)
            return None
        explained = q.T @ self.e
        self.e, self.Q = self.e - q @ explained, np.concatenate([self.Q.T, q.T]).T  # each direction a row of memory
        return Taken(self.place, candidate, q, explained)


def _projected_residuals(linearised: LinearisedData, chosen: Sequence[Candidate], learn: Mask) -> tuple[Array, Array]:
    Q = np.where(learn[:, None], orthonormal_basis(linearised.columns(chosen)[0], learn), 0.0)
    e = linearised.r * learn
    return Q, e - Q @ (Q.T @ e)


def _new_directions(candidate: Candidate, Q: Array, learn: Mask) -> Array:
    """Orthonormal directions (m, p) that a candidate's columns add to Q on the rows that are fitted."""
    # Long vectors are rows here, as those of Q are in memory: a product of a few of them takes half of the time.
    basis, Z = Q.T, np.multiply(candidate.Z.T, learn, order="C")
    norms = np.linalg.norm(Z, axis=1)
    Z = Z / np.where(norms > 0, norms, 1.0)[:, None]
    rest = Z - (Z @ Q) @ basis
    if np.any(np.einsum("km,km->k", rest, rest) < 0.01):
        # With more of a column left, one projection is orthogonal to rounding (Daniel et al. 1976).
        rest = rest - (rest @ Q) @ basis
    squares, vectors = np.linalg.eigh(rest @ rest.T)
    clear = squares > levels.MIN_DISTINCT_SHARE
    return np.asarray(((vectors[:, clear] / np.sqrt(squares[clear])).T @ rest).T)
