"""``Atoms``: what a matching pursuit asks of its candidates, many of one width at a time.

Atoms return their inner products with any vectors and their Gram matrices, of all rows or of some of them; that is all
that a matching pursuit asks.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from posture_opt.diagnosis.scores.candidates import Candidate
from posture_opt.numerics import Array, Codes, Mask


class Atoms(ABC):
    """n candidates of k columns each.

    A dictionary may hold thousands of candidates of the same width k; nothing asks for all their columns at once.
    """

    width: int
    """k."""
    prices: Array
    """(n,) what the criterion charges for each in addition to its parameters."""
    limits: Array
    """(n, 2) the least and the largest size of its parameters [SI]; infinite for most."""
    most: Array
    """(n,) sum of squares that each can explain at the most; infinite for most."""

    @property
    def edges(self) -> tuple[int, ...]:
        """Where the candidates of each kind begin, and where the last ones end: what is next to another is like it."""
        return 0, len(self.prices)

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


class JoinedAtoms(Atoms):
    """Atoms of equal width side by side: what is asked of one is asked of all of them at once."""

    def __init__(self, parts: Sequence[Atoms]) -> None:
        self.width: int = parts[0].width
        self.parts: tuple[Atoms, ...] = tuple(parts)
        self._edges = tuple(np.cumsum([0, *(len(part.prices) for part in parts)]).tolist())
        self.prices: Array = np.concatenate([part.prices for part in parts])
        self.limits: Array = np.concatenate([part.limits for part in parts])
        self.most: Array = np.concatenate([part.most for part in parts])

    @property
    def edges(self) -> tuple[int, ...]:
        """Where each part begins, and where the last one ends."""
        return self._edges

    def grams(self, held_out: Sequence[Codes | None]) -> Array:
        """Inner products (F, n, k, k), part by part."""
        return np.concatenate([part.grams(held_out) for part in self.parts], axis=1)

    def products(self, vectors: Array) -> Array:
        """Inner products (n, k, p) with vectors (m, p), part by part."""
        return np.concatenate([part.products(vectors) for part in self.parts])

    def candidate(self, index: int) -> Candidate:
        """The candidate of the part that has it."""
        part, own = self._place(index)
        return part.candidate(own)

    def finest(self, index: int, Q: Array, e: Array, learn: Mask) -> Candidate:
        """The finest one of the part that has it."""
        part, own = self._place(index)
        return part.finest(own, Q, e, learn)

    def excluded(self, chosen: Candidate) -> Codes:
        """Indices of all parts."""
        places = zip(self.parts, self._edges, strict=False)
        return np.concatenate([part.excluded(chosen) + first for part, first in places])

    def _place(self, index: int) -> tuple[Atoms, int]:
        """The part that has an index, and its index there."""
        part = int(np.searchsorted(self._edges, index, side="right")) - 1
        return self.parts[part], index - self._edges[part]
