"""The dictionary of a search: the columns of every candidate, its atoms, and the lines of all joints among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.diagnosis.scores.column_blocks import ColumnBlocks
from posture_opt.diagnosis.scores.projected_scores import projected_gains
from posture_opt.diagnosis.search.atoms import Atoms, JoinedAtoms
from posture_opt.diagnosis.search.line_atoms import LineAtoms
from posture_opt.diagnosis.search.linearised_data import LinearisedData
from posture_opt.diagnosis.search.selection_criterion import price_of_choice
from posture_opt.diagnosis.search.shape_refinement import finer_shapes
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Codes, Mask

_SHAPES_AT_ONCE = 16  # shapes of one effect that are compared at a time


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

    def grams(self, held_out: Sequence[Codes | None]) -> Array:
        """Inner products (F, n, k, k): those of all rows, taken once, less those of the rows that a fold leaves out."""
        theirs = (None if rows is None else rows[:, None] * self.block + np.arange(self.block) for rows in held_out)
        left = (0.0 if rows is None else self._columns.grams(rows.ravel()) for rows in theirs)
        return np.stack([self._grams - own for own in left])

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

    @cached_property
    def by_width(self) -> tuple[Atoms, ...]:
        """The atoms, those of one width joined."""
        kinds: dict[int, list[Atoms]] = {}
        for atoms in self.atoms:
            kinds.setdefault(atoms.width, []).append(atoms)
        return tuple(own[0] if len(own) == 1 else JoinedAtoms(own) for own in kinds.values())
