"""The dictionary of a search: the columns of every candidate, its atoms, and the lines of all joints among them.

Atoms return their inner products with any vectors and their Gram matrices, of all rows or of some of them; that is all
that a matching pursuit asks.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.diagnosis.scores.candidates import Candidate, Lines
from posture_opt.diagnosis.scores.column_blocks import ColumnBlocks
from posture_opt.diagnosis.scores.fourier_sums import FourierSums, weighted_squares
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.diagnosis.search.projected_scores import projected_gains
from posture_opt.diagnosis.search.selection_criterion import price_of_choice
from posture_opt.diagnosis.search.shape_refinement import finer_shapes
from posture_opt.model.effects import CyclicError, Effect
from posture_opt.numerics import Array, Codes, Mask

_SHAPES_AT_ONCE = 16  # shapes of one effect that are compared at a time
_STEPS_TO_HALF_WAY = 4  # steps to either side from a line of the grid to half way to the next


class Atoms(ABC):
    """n candidates of k columns each.

    A dictionary may hold thousands of candidates of the same width k; nothing asks for all their columns at once.
    """

    prices: Array
    """(n,) what the criterion charges for each in addition to its parameters."""
    limits: Array
    """(n, 2) the least and the largest size of its parameters [SI]; infinite for most."""
    most: Array
    """(n,) sum of squares that each can explain at the most; infinite for most."""

    @abstractmethod
    def grams(self, rows: Codes | None = None) -> Array:
        """(n, k, k) inner products of the columns, of all rows or of some."""

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


class WrittenAtoms(Atoms):
    """Candidates whose columns are stored: everything but lines."""

    def __init__(self, candidates: Sequence[Candidate], sensitivities: EffectSensitivities) -> None:
        self.members: tuple[Candidate, ...] = tuple(candidates)
        self.width: int = candidates[0].Z.shape[1]
        self._sensitivities = sensitivities
        self.block: int = sensitivities.residuals.block
        self._columns = ColumnBlocks.of([c.Z for c in candidates], [c.place for c in candidates])
        self.prices: Array = np.array([price_of_choice(c) for c in candidates])
        open_ended = (-np.inf, np.inf)
        self.limits: Array = np.array([c.what.limits if isinstance(c.what, Effect) else open_ended for c in candidates])
        self.most: Array = np.array([c.most for c in candidates])
        codes: dict[object, list[int]] = {}
        for i, c in enumerate(candidates):
            codes.setdefault(c.exclusive, []).append(i)
        self._alike = codes

    def grams(self, rows: Codes | None = None) -> Array:
        """Inner products (n, k, k), those of all rows taken once."""
        if rows is None:
            return self._grams
        return self._columns.grams((rows[:, None] * self.block + np.arange(self.block)).ravel())

    @cached_property
    def _grams(self) -> Array:
        return self._columns.grams()

    def products(self, vectors: Array) -> Array:
        """Inner products (n, k, p) with vectors (m, p), in single precision inside."""
        return self._columns.products(vectors).astype(float)

    def candidate(self, index: int) -> Candidate:
        """The candidate at an index, as it was listed."""
        return self.members[index]

    def finest(self, index: int, Q: Array, e: Array, learn: Mask) -> Candidate:
        """The best of some shapes between this candidate and its neighbours on the grid, a few at a time for memory."""
        finer = finer_shapes(self._sensitivities, self.members[index])
        best, most = self.members[index], -np.inf
        while some := list(islice(finer, _SHAPES_AT_ONCE)):
            gains = self._gains(some, Q, e, learn) if len(some) > 1 or np.isfinite(most) else np.zeros(1)
            if gains.max() > most:
                best, most = some[int(np.argmax(gains))], float(gains.max())
        return best

    def _gains(self, some: Sequence[Candidate], Q: Array, e: Array, learn: Mask) -> Array:
        """What each of some candidates of this width explains of e."""
        Z = np.concatenate([c.Z for c in some], axis=1) * learn[:, None]
        own = Z.reshape(len(Z), -1, self.width)
        gram = np.einsum("mik,mil->ikl", own, own, optimize=True)
        return projected_gains(gram, (Z.T @ Q).reshape(-1, self.width, Q.shape[1]), (Z.T @ e).reshape(-1, self.width))

    def excluded(self, chosen: Candidate) -> Codes:
        """Indices of other shapes of the same effect."""
        return np.array(self._alike.get(chosen.exclusive, []), dtype=np.intp)


class LineAtoms(Atoms):
    """Cyclic errors of one joint at every frequency that its values resolve.

    The columns of a line are ``c_n sin(k (q_n − q_0))`` and the cosine, c_n what one unit of the joint does to row n.

    Their inner products are Fourier sums over the joint values: all K frequencies cost about as much as one column
    each.
    """

    def __init__(self, linearised: LinearisedData, lines: Lines) -> None:
        self.lines: Lines = lines
        self._sensitivities = linearised.sensitivities
        data = self._sensitivities.residuals.data
        joint = data.joint_names.index(lines.form.joint)
        self.lever: Array = self._sensitivities.joints[joint]
        self.q: Array = data.q[:, joint] - lines.form.centre
        self.sums: FourierSums = FourierSums.of(self.q, lines.cycles)
        price = price_of_choice(lines.candidate(lines.cycles[0], self._sensitivities))
        self.prices: Array = np.full(len(lines.cycles), price)
        self.limits: Array = np.tile([-np.inf, np.inf], (len(lines.cycles), 1))
        self.most: Array = np.full(len(lines.cycles), np.inf)
        self._step = float(lines.cycles[1] - lines.cycles[0]) if len(lines.cycles) > 1 else 0.0

    def grams(self, rows: Codes | None = None) -> Array:
        """Inner products (K, 2, 2) of sine and cosine at every frequency, by `weighted_squares`."""
        q, lever = (v if rows is None else v[rows] for v in (self.q, self.lever))
        weights = np.einsum("nb,nb->n", lever, lever)[:, None]
        ss, sc, cc = weighted_squares(q, self.lines.cycles, weights)
        return np.stack([ss, sc, sc, cc], axis=1).reshape(-1, 2, 2)

    def products(self, vectors: Array) -> Array:
        """Inner products (K, 2, p) with vectors (m, p), by fast Fourier sums."""
        N, block = self.lever.shape
        along = np.einsum("nb,nbp->np", self.lever, vectors[: N * block].reshape(N, block, -1))
        return np.stack(self.sums(along), axis=1)

    def candidate(self, index: int) -> Candidate:
        """The line at a frequency of the grid."""
        return self.lines.candidate(self.lines.cycles[index], self._sensitivities)

    def excluded(self, chosen: Candidate) -> Codes:
        """Indices of lines of the same joint that are too near to a chosen one to be another."""
        if not isinstance(chosen.what, CyclicError) or chosen.what.joint != self.lines.form.joint:
            return np.zeros(0, dtype=np.intp)
        apart = np.abs(self.lines.cycles - chosen.what.cycles)
        return np.flatnonzero(apart <= self.lines.least_distance)

    def finest(self, index: int, Q: Array, e: Array, learn: Mask) -> Candidate:
        """The best line up to half way to the neighbours on the grid, and then to those of a finer one."""
        N, block = self.lever.shape
        lever = self.lever * learn[: N * block].reshape(N, block)
        weights = np.einsum("nb,nb->n", lever, lever)
        along = np.column_stack([np.einsum("nb,nbp->np", lever, Q[: N * block].reshape(N, block, -1)), self._of(e)])
        cycles = float(self.lines.cycles[index])
        for step in (self._step / (2 * _STEPS_TO_HALF_WAY), self._step / (2 * _STEPS_TO_HALF_WAY) ** 2):
            near = cycles + step * np.arange(-_STEPS_TO_HALF_WAY, _STEPS_TO_HALF_WAY + 1)
            waves = np.stack([wave(self.q[:, None] * near) for wave in (np.sin, np.cos)], axis=2)
            gram = np.einsum("nik,nil->ikl", waves * weights[:, None, None], waves, optimize=True)
            inner = np.tensordot(waves, along, axes=(0, 0))
            cycles = float(near[int(np.argmax(projected_gains(gram, inner[:, :, :-1], inner[:, :, -1])))])
        return self.lines.candidate(cycles, self._sensitivities)

    def _of(self, e: Array) -> Array:
        """(N,) residuals e (m,) along what one unit of the joint does to each row."""
        return np.asarray(np.einsum("nb,nb->n", self.lever, e[: self.lever.size].reshape(self.lever.shape)))


@dataclass(frozen=True, eq=False)
class Dictionary:
    """The candidates of a search over linearised data, lines of joints included.

    Two candidates of one exclusive key are shapes of one effect, of which a set holds one.
    """

    linearised: LinearisedData
    candidates: tuple[Candidate, ...]

    @cached_property
    def atoms(self) -> tuple[Atoms, ...]:
        """Candidates of one width side by side, then the lines of each joint."""
        by_width: dict[int, list[Candidate]] = {}
        for candidate in self.candidates:
            by_width.setdefault(candidate.Z.shape[1], []).append(candidate)
        sensitivities = self.linearised.sensitivities
        written = (WrittenAtoms(own, sensitivities) for own in by_width.values())
        if not self.candidates:
            return ()
        return (*written, *(LineAtoms(self.linearised, own) for own in self.linearised.lines))
