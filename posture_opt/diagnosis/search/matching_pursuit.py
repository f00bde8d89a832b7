"""Orthogonal matching pursuit: the candidates that explain residuals, one after another, out of a whole dictionary.

Sources: Chen, Billings, Luo (1989), orthogonal least squares; Pati, Rezaiifar, Krishnaprasad (1993); Mamandipoor,
Ramasamy, Madhow (2016), who fit the frequencies of all lines after each step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.scores.score_tests import orthonormal_basis
from posture_opt.diagnosis.search.atom_states import AtomStates, Taken
from posture_opt.diagnosis.search.dictionary import Dictionary
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.diagnosis.search.shape_refinement import sharpen_lines
from posture_opt.model.effects import CyclicError
from posture_opt.numerics import Array, Codes, Mask

_ROWS_SET_ASIDE = 128  # directions that a basis can take up before it is copied: what is not used costs nothing
_KEPT_SHARE = 0.01  # of a column's squared length: with more left, one projection is orthogonal (Daniel et al. 1976)
_MAX_BASIS_NUMBERS = 16_000_000  # of the bases of pursuits side by side: 130 MB
_BASIS_COLUMNS = 100  # of one basis: geometry, and some forty effects


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
    return _pursue_together(dictionary, most, [held_out])[0]


def pursue_in_folds(dictionary: Dictionary, most: int, folds: Sequence[Codes]) -> Iterator[Pursued]:
    """`pursue_candidates` without the rows of each fold, one after another, as many side by side as memory allows."""
    rows = len(dictionary.linearised.r)
    together = max(1, _MAX_BASIS_NUMBERS // (rows * _BASIS_COLUMNS))
    for first in range(0, len(folds), together):
        yield from _pursue_together(dictionary, most, folds[first : first + together])


def _pursue_together(dictionary: Dictionary, most: int, held_out: Sequence[Codes | None]) -> list[Pursued]:
    """Pursuits side by side: the columns, which are by far the most numbers, are walked through once a step."""
    linearised = dictionary.linearised
    pursuits = [_Pursuit(linearised, place, rows) for place, rows in enumerate(held_out)]
    states = [AtomStates(atoms, held_out) for atoms in dictionary.by_width]
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
    """One of the pursuits that run side by side.

    Args:
        place: among them; held_out: rows that teach it nothing.
    """

    def __init__(self, linearised: LinearisedData, place: int, held_out: Codes | None) -> None:
        block = linearised.sensitivities.residuals.block
        self.place = place
        self._linearised, self._whole = linearised, held_out is None
        self.learn: Mask = np.ones(len(linearised.r), dtype=bool)
        if held_out is not None:
            self.learn[(held_out[:, None] * block + np.arange(block)).ravel()] = False
        self._compact = not self._whole and len(linearised.sensitivities.residuals.data) >= levels.MANY_ROWS
        self._rows = np.zeros((0, 0))
        self.Q, self.e = _projected_residuals(linearised, (), self.learn)
        self.freedom = float(self.learn.sum() - self.Q.shape[1])
        self.chosen, self.runners_up = list[Candidate](), list[Candidate]()
        self._ended = False
        self._together = levels.MAX_EXCHANGED_EFFECTS if len(self.learn) <= levels.MAX_LINE_FIT_RESIDUALS else 0

    @property
    def rss(self) -> float:
        """The sum of squares that is left."""
        return float(self.e @ self.e)

    @property
    def goes_on(self) -> bool:
        """Whether there is anything left to explain, and anything that would."""
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
        self.chosen.append(candidate.compact if self._compact else candidate)
        if isinstance(candidate.what, CyclicError) and self._together >= len(self.chosen):
            self._sharpen(states)
            return None
        explained = q.T @ self.e
        self.e, self.Q = self.e - q @ explained, self._widened(q)
        return Taken(self.place, candidate, q, explained)

    def _widened(self, q: Array) -> Array:
        """The basis with further directions q (m, p): each a row of memory that is set aside for some more."""
        count, more = self.Q.shape[1], q.shape[1]
        if self.Q.base is not self._rows or count + more > len(self._rows):
            former = self.Q.T
            self._rows = np.empty((count + more + _ROWS_SET_ASIDE, len(q)))
            self._rows[:count] = former
        self._rows[count : count + more] = q.T
        return self._rows[: count + more].T

    def _sharpen(self, states: Sequence[AtomStates]) -> None:
        """Fits the lines together, and begins anew with what was chosen."""
        self.chosen = sharpen_lines(self._linearised, self.chosen, self.learn)
        self.Q, self.e = _projected_residuals(self._linearised, self.chosen, self.learn)
        for state in states:
            state.begin(self.place, self.Q, self.e, self.chosen)


def _projected_residuals(linearised: LinearisedData, chosen: Sequence[Candidate], learn: Mask) -> tuple[Array, Array]:
    """An orthonormal basis of geometry and chosen candidates on the rows that teach, and what it leaves of them.

    Returns:
        Q (m, p), zero in the rows left out, and e (m,).
    """
    columns = np.concatenate([linearised.G, *(c.Z for c in chosen)], axis=1)
    Q = np.where(learn[:, None], orthonormal_basis(columns, learn), 0.0)
    e = linearised.r * learn
    return Q, e - Q @ (Q.T @ e)


def _new_directions(candidate: Candidate, Q: Array, learn: Mask) -> Array:
    """Orthonormal directions (m, p) that a candidate's columns add to Q on the rows that are fitted.

    Directions of which less than `levels.MIN_DISTINCT_SHARE` is new are left out.
    """
    # Long vectors are rows here, as those of Q are in memory: a product of a few of them takes half of the time.
    basis, Z = Q.T, np.multiply(candidate.Z.T, learn, order="C")
    norms = np.linalg.norm(Z, axis=1)
    Z = Z / np.where(norms > 0, norms, 1.0)[:, None]
    rest = Z - (Z @ Q) @ basis
    if np.any(np.einsum("km,km->k", rest, rest) < _KEPT_SHARE):  # rounding of what was taken off is no part of the rest
        rest = rest - (rest @ Q) @ basis
    squares, vectors = np.linalg.eigh(rest @ rest.T)
    clear = squares > levels.MIN_DISTINCT_SHARE
    return np.asarray(((vectors[:, clear] / np.sqrt(squares[clear])).T @ rest).T)
