"""Obstacle ``half_space``: the floor, a wall, a ceiling."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field, field_validator

from posture_opt.collision.facets import rectangle
from posture_opt.collision.obstacles.obstacle import FREE, Obstacle, ProductSolid, Size
from posture_opt.errors import BadValueError
from posture_opt.numerics import Array
from posture_opt.units import Length


class HalfSpace(Obstacle):
    """All points with ``normal · x < offset``, the normal of any length taken as a unit vector."""

    summary: ClassVar[str] = "solid where normal . x < offset: a floor, a wall"

    kind: Literal["half_space"]
    normal: tuple[float, float, float] = Field((0.0, 0.0, 1.0), description="of its surface, out of the solid; world")
    offset: Length = Field(0.0, description="of its surface from the origin, along the normal")

    @field_validator("normal")
    @classmethod
    def _points_somewhere(cls, normal: tuple[float, float, float]) -> tuple[float, float, float]:
        if math.hypot(*normal) < 1e-12:
            raise BadValueError("a normal of length zero points nowhere", "write for example [0, 0, 1]")
        return normal

    @property
    def unit_normal(self) -> tuple[float, float, float]:
        """(3,) unit vector out of the solid, world."""
        x, y, z = self.normal
        size = math.hypot(x, y, z)
        return x / size, y / size, z / size

    def smaller(self, by: Size) -> Self:
        return self.model_copy(update={"offset": self.offset - by})

    @property
    def half_thickness(self) -> float:
        return math.inf

    def moved(self, shift: Sequence[Size]) -> Self:
        along = sum(n * d for n, d in zip(self.unit_normal, shift, strict=True))
        return self.model_copy(update={"offset": self.offset + along})

    @property
    def product(self) -> ProductSolid:
        normal = np.array(self.unit_normal)
        side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        side /= np.linalg.norm(side)
        rotation = np.column_stack([normal, side, np.cross(normal, side)])
        return ProductSolid(rotation, self.offset * normal, (0, FREE, FREE), (0.0, 0.0, 0.0), one_sided=True)

    def distance(self, start: Array, end: Array) -> Array:
        """(...) least height of segments (..., 3) over the surface [m], world; negative by the depth below it."""
        normal = np.array(self.unit_normal)
        return np.asarray(np.minimum(start @ normal, end @ normal) - self.offset)

    def extent(self, direction: Array) -> float:
        along = float(np.dot(self.unit_normal, direction))
        return self.offset if along > 1 - 1e-12 else math.inf  # rounding of a cosine

    def facets(self, lower: Array, upper: Array) -> Array:
        normal, middle = np.array(self.unit_normal), (lower + upper) / 2
        foot = middle - (middle @ normal - self.offset) * normal
        u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        u *= float(np.linalg.norm(upper - lower)) / 2 / np.linalg.norm(u)
        faces = rectangle(foot, u, np.cross(normal, u), 24)
        inside = np.all((faces >= lower - 1e-9) & (faces <= upper + 1e-9), axis=(1, 2))
        return np.asarray(faces[inside])

    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        n = ca.DM(list(self.unit_normal))
        ends = [start] if along.is_zero() else [start, start + along]
        return [ca.dot(n, end) - self.offset - radius for end in ends]
