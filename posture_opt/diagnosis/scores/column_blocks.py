"""The columns of candidates side by side in memory: in single precision, and of many rows nowhere else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np

from posture_opt.numerics import Array, Codes

_CANDIDATES_PER_BLOCK = 64  # candidates of one block: enough for a fast product, and few columns are set aside in vain
_CANDIDATES_COPIED = 16  # candidates whose columns at some rows are copied at a time


@dataclass(frozen=True, eq=False)
class ColumnPlace:
    """Where the columns of a candidate are kept.

    Args:
        block: (candidates, k, m) columns of several candidates, single precision.
        index: which of them it is.
    """

    block: Array
    index: int

    @property
    def columns(self) -> Array:
        """The columns (m, k), a view."""
        return np.asarray(self.block[self.index].T)


@dataclass(eq=False)
class ColumnStore:
    """Takes columns (m, k) one by one; those of one key and width are in the same blocks.

    Seven digits are enough: what is chosen is fitted anew, from columns of its own.
    """

    _open: dict[object, tuple[Array, int]] = field(default_factory=dict)

    def keep(self, key: object, Z: Array) -> ColumnPlace:
        """A copy of the columns Z (m, k), in a block with those of the same key."""
        key = key, Z.shape[1]
        # Memory that is set aside and never written to costs nothing.
        block, count = self._open.get(key, (np.zeros((0, 0, 0)), 0))
        if count == len(block):
            block, count = np.empty((_CANDIDATES_PER_BLOCK, Z.shape[1], len(Z)), dtype=np.float32), 0
        block[count] = Z.T
        self._open[key] = block, count + 1
        return ColumnPlace(block, count)


@dataclass(frozen=True, eq=False)
class ColumnBlocks:
    """n candidates of k columns each, in blocks (n_i, k, m)."""

    blocks: tuple[Array, ...]

    @classmethod
    def of(cls, columns: Sequence[Array], places: Sequence[ColumnPlace | None]) -> ColumnBlocks:
        """Of columns (m, k) each; those that are in blocks already, in their order, are not copied."""
        found, at = list[Array](), 0
        for _, run in groupby(places, lambda place: None if place is None else id(place.block)):
            own = list(run)
            first, last = own[0], own[-1]
            if first is None or last is None:
                parts = columns[at : at + len(own)]
                # In the order of memory that products walk through: they would copy all of it each time.
                found.append(np.ascontiguousarray([Z.T for Z in parts], dtype=np.float32))
            elif last.index - first.index + 1 == len(own):
                found.append(first.block[first.index : last.index + 1])
            else:
                found.append(first.block[[place.index for place in own if place is not None]])
            at += len(own)
        return cls(tuple(found))

    def grams(self, rows: Codes | None = None) -> Array:
        """(n, k, k) inner products of the columns of each candidate, of all residuals or of some.

        Args:
            rows: indices of residuals; all by default.
        """
        found = []
        for block in self.blocks:
            for first in range(0, len(block), _CANDIDATES_COPIED):
                part = block[first : first + _CANDIDATES_COPIED]
                part = part if rows is None else part[:, :, rows]
                found.append(part @ np.swapaxes(part, 1, 2))
        return np.concatenate(found).astype(float)

    def products(self, vectors: Array) -> Array:
        """(n, k, p) inner products with vectors (m, p)."""
        v = vectors.astype(np.float32)
        return np.concatenate([(block.reshape(-1, len(v)) @ v).reshape(*block.shape[:2], -1) for block in self.blocks])
