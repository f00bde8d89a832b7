"""Obstacles that are boxes, cylinders and spheres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field

from posture_opt.collision.facets import capsule_facets, rectangle, revolved
from posture_opt.collision.obstacles.obstacle import Obstacle, PlacedObstacle, ProductSolid, Side, Size
from posture_opt.collision.segment_distances import to_box, to_cylinder, to_point
from posture_opt.collision.smooth_bounds import box_bound, cylinder_bound, point_bound
from posture_opt.numerics import Array
from posture_opt.units import Length

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
