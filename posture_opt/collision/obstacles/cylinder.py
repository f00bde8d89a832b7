"""Obstacle ``cylinder``: a post, a drum, a pipe."""

from __future__ import annotations

import math
from typing import ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field

from posture_opt.collision.facets import revolved
from posture_opt.collision.obstacles.obstacle import PlacedObstacle, ProductSolid, Side, Size
from posture_opt.collision.segment_distances import to_cylinder
from posture_opt.collision.smooth_bounds import cylinder_bound
from posture_opt.numerics import Array


class Cylinder(PlacedObstacle):
    """A solid cylinder with flat ends about z of its frame, half its length to either side of the origin."""

    summary: ClassVar[str] = "a cylinder (radius, length) about the z axis of its frame, xyz in its middle"

    kind: Literal["cylinder"]
    radius: Side = Field(description="of the cylinder")
    length: Side = Field(description="along its own z axis")

    def smaller(self, by: Size) -> Self:
        return self.model_copy(update={"radius": self.radius - by, "length": self.length - 2 * by})

    @property
    def half_thickness(self) -> float:
        return min(self.radius, self.length / 2)

    @property
    def product(self) -> ProductSolid:
        size = self.radius, self.length / 2, 0.0
        return ProductSolid(self.rotation, np.array(self.xyz), (0, 0, 1), size)

    def distance(self, start: Array, end: Array) -> Array:
        return to_cylinder(self.local(start), self.local(end), self.radius, self.length / 2)

    def extent(self, direction: Array) -> float:
        axial = abs(float(direction @ self.rotation[:, 2]))
        across = math.sqrt(max(1 - axial**2, 0.0))
        return float(np.dot(self.xyz, direction)) + self.length / 2 * axial + self.radius * across

    def facets(self, lower: Array, upper: Array) -> Array:
        heights = np.linspace(-self.length / 2, self.length / 2, 8 + 1)
        around = np.column_stack([np.full(8 + 1, self.radius), heights])
        ends = [[[0.0, z], [self.radius / 2, z], [self.radius, z]] for z in (heights[0], heights[-1])]
        return np.concatenate([revolved(profile, self.placed) for profile in (around, *map(np.array, ends))])

    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        return [cylinder_bound(*self.local_symbols(start, along), self.radius, self.length / 2, radius)]
