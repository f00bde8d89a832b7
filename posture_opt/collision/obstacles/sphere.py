"""Obstacle ``sphere``: a lamp, or room to keep about a point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field

from posture_opt.collision.facets import capsule_facets
from posture_opt.collision.obstacles.obstacle import Obstacle, ProductSolid, Side, Size
from posture_opt.collision.segment_distances import to_point
from posture_opt.collision.smooth_bounds import point_bound
from posture_opt.numerics import Array
from posture_opt.units import Length


class Sphere(Obstacle):
    """A ball about a point of the world."""

    summary: ClassVar[str] = "a sphere (radius) about xyz"

    kind: Literal["sphere"]
    radius: Side = Field(description="of the sphere")
    xyz: tuple[Length, Length, Length] = Field((0.0, 0.0, 0.0), description="its middle, world")

    def smaller(self, by: Size) -> Self:
        return self.model_copy(update={"radius": self.radius - by})

    @property
    def half_thickness(self) -> float:
        return self.radius

    def moved(self, shift: Sequence[Size]) -> Self:
        return self.model_copy(update={"xyz": tuple(x + d for x, d in zip(self.xyz, shift, strict=True))})

    @property
    def product(self) -> ProductSolid:
        return ProductSolid(np.eye(3), np.array(self.xyz), (0, 0, 0), (self.radius, 0.0, 0.0))

    def distance(self, start: Array, end: Array) -> Array:
        return to_point(start, end, np.array(self.xyz)) - self.radius

    def extent(self, direction: Array) -> float:
        return float(np.dot(self.xyz, direction)) + self.radius

    def facets(self, lower: Array, upper: Array) -> Array:
        return capsule_facets(np.array(self.xyz), np.array(self.xyz), self.radius)

    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        return [point_bound(start, along, length, self.xyz, radius + self.radius)]
