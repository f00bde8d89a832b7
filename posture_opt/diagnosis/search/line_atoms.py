"""``LineAtoms``: cyclic errors of one joint as candidates of a matching pursuit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.scores.candidates import Candidate, Lines
from posture_opt.diagnosis.scores.fourier_sums import FourierSums, weighted_squares
from posture_opt.diagnosis.scores.projected_scores import projected_gains
from posture_opt.diagnosis.search.atoms import Atoms
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.diagnosis.search.selection_criterion import price_of_choice
from posture_opt.model.effects import CyclicError
from posture_opt.numerics import Array, Codes, Mask

_STEPS_TO_HALF_WAY = 4  # steps to either side from a line of the grid to half way to the next


class LineAtoms(Atoms):
    """Cyclic errors of one joint at every frequency that its values resolve.

    The columns of a line are ``c_n sin(k (q_n − q_0))`` and the cosine, c_n what one unit of the joint does to row n.

    Their inner products are Fourier sums over the joint values: all K frequencies cost about as much as one column
    each.
    """

    def __init__(self, linearised: LinearisedData, lines: Lines) -> None:
        self.width = 2
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

    def grams(self, held_out: Sequence[Codes | None]) -> Array:
        """Inner products (F, K, 2, 2) of sine and cosine at every frequency, of all folds by one transform."""
        weights = np.repeat(np.einsum("nb,nb->n", self.lever, self.lever)[:, None], len(held_out), axis=1)
        for fold, rows in enumerate(held_out):
            if rows is not None:
                weights[rows, fold] = 0.0
        ss, sc, cc = weighted_squares(self.q, self.lines.cycles, weights)
        return np.stack([ss.T, sc.T, sc.T, cc.T], axis=2).reshape(len(held_out), -1, 2, 2)

    def products(self, vectors: Array) -> Array:
        """Inner products (K, 2, p) with vectors (m, p), by fast Fourier sums."""
        N, block = self.lever.shape
        parts = vectors.T[:, : N * block].reshape(-1, N, block)  # long vectors are rows in memory: nothing is copied
        along = (np.swapaxes(parts, 0, 1) @ self.lever[:, :, None])[:, :, 0]
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
        parts = Q.T[:, : N * block].reshape(-1, N, block)  # a basis is kept by columns: nothing is copied
        along = np.column_stack([(np.swapaxes(parts, 0, 1) @ lever[:, :, None])[:, :, 0], self._of(e)])
        cycles = float(self.lines.cycles[index])
        middle = np.exp(1j * cycles * self.q)
        for step in (self._step / (2 * _STEPS_TO_HALF_WAY), self._step / (2 * _STEPS_TO_HALF_WAY) ** 2):
            waves = _waves_about(middle, np.exp(1j * step * self.q))
            inner = np.swapaxes((np.concatenate([waves.imag, waves.real]) @ along).reshape(2, len(waves), -1), 0, 1)
            best = int(np.argmax(projected_gains(_line_grams(waves, weights), inner[:, :, :-1], inner[:, :, -1])))
            cycles, middle = cycles + step * (best - _STEPS_TO_HALF_WAY), waves[best]
        return self.lines.candidate(cycles, self._sensitivities)

    def _of(self, e: Array) -> Array:
        """(N,) residuals e (m,) along what one unit of the joint does to each row."""
        return np.asarray(np.einsum("nb,nb->n", self.lever, e[: self.lever.size].reshape(self.lever.shape)))


def _waves_about(middle: NDArray[np.complex128], turn: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """(2 s + 1, N) waves ``exp(i k q)`` of one frequency (N,) and of s steps to either side, each ``turn`` (N,)."""
    waves = np.empty((2 * _STEPS_TO_HALF_WAY + 1, len(middle)), dtype=complex)
    waves[_STEPS_TO_HALF_WAY] = middle
    for away in range(_STEPS_TO_HALF_WAY):
        above, below = _STEPS_TO_HALF_WAY + away, _STEPS_TO_HALF_WAY - away
        waves[above + 1], waves[below - 1] = waves[above] * turn, waves[below] * turn.conj()
    return waves


def _line_grams(waves: NDArray[np.complex128], weights: Array) -> Array:
    """(K, 2, 2) inner products of sine and cosine of K waves (K, N) under weights (N,), from twice their angles."""
    total, twice = float(weights.sum()), waves**2 @ weights
    entries = (total - twice.real, twice.imag, twice.imag, total + twice.real)
    return np.stack(entries, axis=1).reshape(-1, 2, 2) / 2
