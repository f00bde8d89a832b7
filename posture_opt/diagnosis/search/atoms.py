"""What a matching pursuit asks of its candidates, and all candidates of a search, lines of joints among them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, islice

import numpy as np

from posture_opt.calibration.cross_validation import residual_indices
from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.diagnosis.scores.candidates import Candidate, LinearisedData, Lines
from posture_opt.diagnosis.scores.score_tests import FourierSums, weighted_squares
from posture_opt.diagnosis.scores.subset_selection import projected_gains
from posture_opt.diagnosis.search.selection_criterion import price_of_choice
from posture_opt.diagnosis.search.shape_refinement import finer_shapes
from posture_opt.model.effects import CyclicError
from posture_opt.numerics import Array, Codes, Mask


class Atoms(ABC):
    """n candidates of k columns each; nothing asks for all their columns at once.

    Args:
        prices: (n,) charge of the criterion for each in addition to its parameters.
        limits: (n, 2) the least and the largest size of its parameters [SI]; infinite for most.
        most: (n,) sum of squares that each can explain at the most; infinite for most.
    """

    prices: Array
    limits: Array
    most: Array

    @abstractmethod
    def grams(self, held_out: Sequence[Codes | None]) -> Array:
        """(F, n, k, k) inner products of the columns in all rows but those of each fold, None for none."""

    @abstractmethod
    def products(self, vectors: Array) -> Array:
        """(n, k, p) inner products of the columns with vectors (m, p)."""

    @abstractmethod
    def candidate(self, index: int) -> Candidate:
        """One of the candidates."""

    @abstractmethod
    def excluded(self, chosen: Candidate) -> Codes:
        """Indices of those that no model holds together with a chosen candidate."""

    @abstractmethod
    def finest(self, index: int, Q: Array, e: Array, learn: Mask) -> Candidate:
        """The candidate between this one and its neighbours on the grid that explains most.

        Args:
            Q: (m, p) basis of what was chosen, and e (m,) what it leaves, both zero but in the rows ``learn`` (m,).
        """


_HALF_WAY = 4  # steps to either side from a line of the grid to half way to the next


class LineAtoms(Atoms):
    """Cyclic errors of one joint at every frequency that its values resolve.

    The columns of a line are ``c_n sin(k (q_n − q_0))`` and the cosine, c_n what one unit of the joint does to row n.
    Their inner products are Fourier sums: all K frequencies cost about as much as one column each.
    """

    def __init__(self, linearised: LinearisedData, lines: Lines) -> None:
        self.lines: Lines = lines
        self._sensitivities = linearised.sensitivities
        data = self._sensitivities.residuals.data
        joint = data.joint_names.index(lines.form.joint)
        self.lever: Array = self._sensitivities.joints[joint]
        self.q: Array = data.q[:, joint] - lines.form.centre
        self.sums: FourierSums = FourierSums.of(self.q, lines.cycles)
        count = len(lines.cycles)
        self.prices: Array = np.full(count, price_of_choice(self.candidate(0)))
        self.limits: Array = np.tile([-np.inf, np.inf], (count, 1))
        self.most: Array = np.full(count, np.inf)

    def grams(self, held_out: Sequence[Codes | None]) -> Array:
        weights = np.repeat(np.einsum("nb,nb->n", self.lever, self.lever)[:, None], len(held_out), axis=1)
        for fold, rows in enumerate(held_out):
            if rows is not None:
                weights[rows, fold] = 0.0
        ss, sc, cc = weighted_squares(self.q, self.lines.cycles, weights)
        return np.stack([ss.T, sc.T, sc.T, cc.T], axis=2).reshape(len(held_out), -1, 2, 2)

    def products(self, vectors: Array) -> Array:
        return np.stack(self.sums(_along(vectors, self.lever)), axis=1)

    def candidate(self, index: int) -> Candidate:
        return self.lines.candidate(self.lines.cycles[index], self._sensitivities)

    def excluded(self, chosen: Candidate) -> Codes:
        """Indices of lines of the same joint that are too near to a chosen one to be another."""
        if not isinstance(chosen.what, CyclicError) or chosen.what.joint != self.lines.form.joint:
            return np.zeros(0, dtype=np.intp)
        return np.flatnonzero(np.abs(self.lines.cycles - chosen.what.cycles) <= self.lines.least_distance)

    def finest(self, index: int, Q: Array, e: Array, learn: Mask) -> Candidate:
        """The best line up to half way to the neighbours on the grid, and then to those of a finer one."""
        lever = self.lever * learn[: self.lever.size].reshape(self.lever.shape)
        weights = np.einsum("nb,nb->n", lever, lever)
        along = np.column_stack([_along(Q, lever), _along(e[:, None], self.lever)])
        cycles, spacing = float(self.lines.cycles[index]), float(np.diff(self.lines.cycles[:2]).sum())
        middle = np.exp(1j * cycles * self.q)
        for step in (spacing / (2 * _HALF_WAY), spacing / (2 * _HALF_WAY) ** 2):
            waves = middle * np.exp(1j * step * np.arange(-_HALF_WAY, _HALF_WAY + 1)[:, None] * self.q)
            inner = np.swapaxes((np.concatenate([waves.imag, waves.real]) @ along).reshape(2, len(waves), -1), 0, 1)
            # Inner products of sine and cosine, from twice their angles.
            total, twice = float(weights.sum()), waves**2 @ weights
            entries = (total - twice.real, twice.imag, twice.imag, total + twice.real)
            gram = np.stack(entries, axis=1).reshape(-1, 2, 2) / 2
            best = int(np.argmax(projected_gains(gram, inner[:, :, :-1], inner[:, :, -1])))
            cycles, middle = cycles + step * (best - _HALF_WAY), waves[best]
        return self.lines.candidate(cycles, self._sensitivities)


def _along(vectors: Array, lever: Array) -> Array:
    """(N, p) vectors (m, p) along what one unit of a joint, ``lever`` (N, block), does to each row."""
    parts = vectors.T[:, : lever.size].reshape(-1, *lever.shape)  # long vectors are rows in memory: nothing is copied
    return np.asarray((np.swapaxes(parts, 0, 1) @ lever[:, :, None])[:, :, 0])


class WrittenAtoms(Atoms):
    def __init__(self, candidates: Sequence[Candidate], sensitivities: EffectSensitivities) -> None:
        self.members: tuple[Candidate, ...] = tuple(candidates)
        self._sensitivities = sensitivities
        self._blocks = _column_blocks(candidates)
        self._grams = self._products_of_columns(None)
        self.prices: Array = np.array([price_of_choice(c) for c in candidates])
        self.limits: Array = np.array([c.what.limits for c in candidates])
        self.most: Array = np.array([c.most for c in candidates])
        self._alike: dict[object, list[int]] = {}
        for i, c in enumerate(candidates):
            self._alike.setdefault(c.what.exclusive, []).append(i)

    def grams(self, held_out: Sequence[Codes | None]) -> Array:
        """Inner products (F, n, k, k): those of all rows, taken once, less those of the rows that a fold leaves out."""
        block = self._sensitivities.residuals.block
        theirs = (None if rows is None else residual_indices(rows, block) for rows in held_out)
        return np.stack([self._grams - (0.0 if own is None else self._products_of_columns(own)) for own in theirs])

    def _products_of_columns(self, rows: Codes | None) -> Array:
        """(n, k, k) inner products of the columns of each, of all residuals or some; 16 candidates copied at a time."""
        few = (block[first : first + 16] for block in self._blocks for first in range(0, len(block), 16))
        parts = (part if rows is None else part[:, :, rows] for part in few)
        return np.concatenate([part @ np.swapaxes(part, 1, 2) for part in parts]).astype(float)

    def products(self, vectors: Array) -> Array:
        """Inner products (n, k, p) with vectors (m, p), in single precision inside."""
        v = vectors.astype(np.float32)
        found = [(block.reshape(-1, len(v)) @ v).reshape(*block.shape[:2], -1) for block in self._blocks]
        return np.concatenate(found).astype(float)

    def candidate(self, index: int) -> Candidate:
        return self.members[index]

    def finest(self, index: int, Q: Array, e: Array, learn: Mask) -> Candidate:
        """The best of some shapes between this candidate and its neighbours on the grid, 16 at a time for memory."""
        finer = finer_shapes(self._sensitivities, self.members[index])
        best, most = self.members[index], -np.inf
        while some := list(islice(finer, 16)):
            gains = self._gains(some, Q, e, learn) if len(some) > 1 or np.isfinite(most) else np.zeros(1)
            if gains.max() > most:
                best, most = some[int(np.argmax(gains))], float(gains.max())
        return best

    def _gains(self, some: Sequence[Candidate], Q: Array, e: Array, learn: Mask) -> Array:
        k = some[0].Z.shape[1]
        Z = np.concatenate([c.Z for c in some], axis=1) * learn[:, None]
        own = Z.reshape(len(Z), -1, k)
        gram = np.einsum("mik,mil->ikl", own, own, optimize=True)
        return projected_gains(gram, (Z.T @ Q).reshape(-1, k, Q.shape[1]), (Z.T @ e).reshape(-1, k))

    def excluded(self, chosen: Candidate) -> Codes:
        return np.array(self._alike.get(chosen.what.exclusive, []), dtype=np.intp)


def _column_blocks(candidates: Sequence[Candidate]) -> list[Array]:
    """Blocks (n_i, k, m) of the columns; those that are in blocks already, in their order, are not copied."""
    found = list[Array]()
    for _, run in groupby(candidates, lambda c: None if c.place is None else id(c.place.block)):
        own = list(run)
        places = [c.place for c in own if c.place is not None]
        if not places:  # in the order of memory that products walk through: they would copy all of it each time
            found.append(np.ascontiguousarray([c.Z.T for c in own], dtype=np.float32))
        elif places[-1].index - places[0].index + 1 == len(own):
            found.append(places[0].block[places[0].index : places[-1].index + 1])
        else:
            found.append(places[0].block[[place.index for place in places]])
    return found


@dataclass(frozen=True, eq=False)
class Dictionary:
    """The candidates of a search over linearised data, lines of joints included."""

    linearised: LinearisedData
    candidates: tuple[Candidate, ...]

    @cached_property
    def atoms(self) -> tuple[Atoms, ...]:
        """Candidates of one width side by side, then the lines of each joint."""
        by_width: dict[int, list[Candidate]] = {}
        for candidate in self.candidates:
            by_width.setdefault(candidate.Z.shape[1], []).append(candidate)
        written = (WrittenAtoms(own, self.linearised.sensitivities) for own in by_width.values())
        lines = self.linearised.lines if self.candidates else ()
        return (*written, *(LineAtoms(self.linearised, own) for own in lines))
