"""``Grid``: the targets of a map, in a plane that a figure can show."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from posture_opt.numerics import Array, Codes

ALIGNED = 1e-9  # off one, of the largest component of a unit vector along an axis: rounding


@dataclass(frozen=True, eq=False)
class Grid:
    """Targets ``origin + u e1 + v e2 + w e3``, u running fastest.

    Args:
        origin: (3,) [m], world.
        axes: (3, 3) unit vectors e1, e2, e3, one a row: the two that a figure shows, and the one across them.
        values: of u, v, w [m], ascending.
    """

    origin: Array
    axes: Array
    values: tuple[Array, Array, Array]

    @property
    def shape(self) -> tuple[int, int, int]:
        """How many values of w, v and u: the shape of an array over all targets."""
        u, v, w = map(len, self.values)
        return w, v, u

    @property
    def aligned(self) -> bool:
        """Whether u, v, w are coordinates of the world."""
        return not self.origin.any() and along_world_axes(self.axes)

    @cached_property
    def points(self) -> Array:
        """(N, 3) all targets in the world [m]."""
        w, v, u = np.meshgrid(*self.values[::-1], indexing="ij")
        return np.asarray(self.origin + np.stack([u, v, w], axis=-1).reshape(-1, 3) @ self.axes)

    def coordinates(self, points: Array) -> Array:
        """(N, 3) u, v, w of points in the world (N, 3) [m]."""
        return np.asarray((points - self.origin) @ self.axes.T)

    @cached_property
    def neighbours(self) -> tuple[tuple[Codes, Codes], ...]:
        """For every direction to one of the neighbours: the targets that have one there, and those neighbours."""
        index = np.arange(math.prod(self.shape)).reshape(self.shape)
        steps = [(0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 1, 1), (0, 1, -1)]
        pairs = []
        for step in steps:
            here = index[tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in zip(step, self.shape, strict=True))].ravel()
            there = index[
                tuple(slice(max(s, 0), n - max(-s, 0)) for s, n in zip(step, self.shape, strict=True))
            ].ravel()
            pairs += [(here, there), (there, here)] if len(here) else []
        return tuple(pairs)

    def cells(self, points: Array) -> Codes:
        """(N,) the target in whose cell each point (N, 3) lies; -1 outside of all cells.

        Across the figure's plane a cell is as thick as its layers lie apart; of a single layer, as its longer side.
        """
        at = self.coordinates(points)
        sides = self.sides
        index, inside = [], np.ones(len(points), dtype=bool)
        for k, values in enumerate(self.values):
            nearest = np.abs(at[:, k, None] - values).argmin(axis=1)
            inside &= np.abs(at[:, k] - values[nearest]) <= sides[k] / 2
            index.append(nearest)
        return np.where(inside, np.ravel_multi_index(tuple(index[::-1]), self.shape), -1)

    def to_json(self) -> dict[str, Any]:
        """Axes, origin and values of the grid [m]."""
        return {
            "origin": self.origin.tolist(),
            "axes": self.axes.tolist(),
            "values": [values.tolist() for values in self.values],
            "order": "the first axis runs fastest",
        }

    @property
    def sides(self) -> tuple[float, float, float]:
        """Edges of a cell along u, v, w [m]; along an axis with one value, the longest of the others."""
        steps = [float(values[1] - values[0]) if len(values) > 1 else 0.0 for values in self.values]
        a, b, c = (step or max(steps) for step in steps)
        return a, b, c


def along_world_axes(axes: Array) -> bool:
    """Whether unit vectors (k, 3), one a row, all lie along axes of the world."""
    return bool(np.all(np.max(np.abs(axes), axis=1) > 1 - ALIGNED))
