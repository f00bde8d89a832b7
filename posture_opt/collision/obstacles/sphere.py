"""Obstacle ``sphere``: a lamp, or room to keep about a point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field

from posture_opt.collision.facets import capsule_facets
from posture_opt.collision.obstacles.obstacle import Obstacle, Side, Size
from posture_opt.collision.product_solid import ProductSolid
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
        """The same sphere with a radius smaller by ``by`` [m]."""
        return self.model_copy(update={"radius": self.radius - by})

    @property
    def half_thickness(self) -> float:
        """The radius [m]."""
        return self.radius

    def moved(self, shift: Sequence[Size]) -> Self:
        """The same sphere with its middle shifted by (3,) [m], world."""
        return self.model_copy(update={"xyz": tuple(x + d for x, d in zip(self.xyz, shift, strict=True))})

    @property
    def product(self) -> ProductSolid:
        """A ball about its middle."""
        return ProductSolid(np.eye(3), np.array(self.xyz), (0, 0, 0), (self.radius, 0.0, 0.0))

    def distance(self, start: Array, end: Array) -> Array:
        """(...) exact distance of segments (..., 3) [m], world; negative where they enter it."""
        return to_point(start, end, np.array(self.xyz)) - self.radius

    def extent(self, direction: Array) -> float:
        """Greatest coordinate of its points along a unit vector (3,), world [m]."""
        return float(np.dot(self.xyz, direction)) + self.radius

    def facets(self, lower: Array, upper: Array) -> Array:
        """(k, 4, 3) small faces of its surface [m], world."""
        return capsule_facets(np.array(self.xyz), np.array(self.xyz), self.radius)

    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        """The distance of a capsule [m], which is smooth and exact."""
        return [point_bound(start, along, length, self.xyz, radius + self.radius)]
