"""Obstacle ``box``: a table, a wall, a fixture."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field

from posture_opt.collision.facets import rectangle
from posture_opt.collision.obstacles.obstacle import PlacedObstacle, ProductSolid, Side, Size
from posture_opt.collision.segment_distances import to_box
from posture_opt.collision.smooth_bounds import box_bound
from posture_opt.numerics import Array

_EDGE_PIECES = 10, 40
"""Faces along an edge in drawings: where the box is as large as the drawing, and at most."""


class Box(PlacedObstacle):
    """A box of three side lengths about the origin of its frame."""

    summary: ClassVar[str] = "a box (size: its sides) about xyz, turned by rpy"

    kind: Literal["box"]
    size: tuple[Side, Side, Side] = Field(description="its sides along its own x, y, z")

    @property
    def half(self) -> tuple[float, float, float]:
        """(3,) half sides [m], frame of the box."""
        x, y, z = self.size
        return x / 2, y / 2, z / 2

    def smaller(self, by: Size) -> Self:
        return self.model_copy(update={"size": tuple(side - 2 * by for side in self.size)})

    @property
    def half_thickness(self) -> float:
        return min(self.half)

    @property
    def product(self) -> ProductSolid:
        return ProductSolid(self.rotation, np.array(self.xyz), (0, 1, 2), self.half)

    def distance(self, start: Array, end: Array) -> Array:
        return to_box(self.local(start), self.local(end), np.array(self.half))

    def extent(self, direction: Array) -> float:
        return float(np.dot(self.xyz, direction) + np.abs(direction @ self.rotation) @ np.array(self.half))

    def facets(self, lower: Array, upper: Array) -> Array:
        sides = self.rotation * np.array(self.half)
        least, most = _EDGE_PIECES
        pieces = int(np.clip(least * max(self.size) / np.linalg.norm(upper - lower), least, most))
        faces = [
            rectangle(np.array(self.xyz) + sign * sides[:, k], sides[:, k - 1], sides[:, k - 2], pieces)
            for k in range(3)
            for sign in (-1, 1)
        ]
        return np.concatenate(faces)

    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        return [box_bound(*self.local_symbols(start, along), self.half, radius)]
