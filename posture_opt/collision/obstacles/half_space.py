"""Obstacle ``half_space``: the floor, a wall, a ceiling."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field, field_validator

from posture_opt.collision.facets import rectangle
from posture_opt.collision.obstacles.obstacle import Obstacle, Size
from posture_opt.collision.product_solid import FREE, ProductSolid
from posture_opt.collision.segment_distances import to_half_space
from posture_opt.collision.smooth_bounds import half_space_bounds
from posture_opt.errors import BadValueError
from posture_opt.numerics import Array
from posture_opt.units import Length

_PARALLEL = 1e-12
"""What the cosine between two parallel unit vectors may lack by rounding."""
_PATCH_PIECES = 24
"""Faces along the side of the patch that is drawn."""


class HalfSpace(Obstacle):
    """All points with ``normal · x < offset``, the normal of any length taken as a unit vector."""

    summary: ClassVar[str] = "solid where normal . x < offset: a floor, a wall"

    kind: Literal["half_space"]
    normal: tuple[float, float, float] = Field((0.0, 0.0, 1.0), description="of its surface, out of the solid; world")
    offset: Length = Field(0.0, description="of its surface from the origin, along the normal")

    @field_validator("normal")
    @classmethod
    def _points_somewhere(cls, normal: tuple[float, float, float]) -> tuple[float, float, float]:
        """The normal as it is.

        Raises:
            BadValueError: its length is zero.
        """
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
        """The same half-space with its surface ``by`` [m] farther in."""
        return self.model_copy(update={"offset": self.offset - by})

    @property
    def half_thickness(self) -> float:
        """Infinite: there is always something left."""
        return math.inf

    def moved(self, shift: Sequence[Size]) -> Self:
        """The same half-space shifted by (3,) [m], world: only the part along its normal counts."""
        along = sum(n * d for n, d in zip(self.unit_normal, shift, strict=True))
        return self.model_copy(update={"offset": self.offset + along})

    @property
    def product(self) -> ProductSolid:
        """All below zero along the first axis of a frame on its surface."""
        normal = np.array(self.unit_normal)
        side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        side /= np.linalg.norm(side)
        rotation = np.column_stack([normal, side, np.cross(normal, side)])
        return ProductSolid(rotation, self.offset * normal, (0, FREE, FREE), (0.0, 0.0, 0.0), one_sided=True)

    def distance(self, start: Array, end: Array) -> Array:
        """(...) least height of segments (..., 3) over the surface [m], world; negative by the depth below it."""
        return to_half_space(start, end, np.array(self.unit_normal), self.offset)

    def extent(self, direction: Array) -> float:
        """Greatest coordinate of its points along a unit vector (3,), world [m]: finite along its normal only."""
        along = float(np.dot(self.unit_normal, direction))
        return self.offset if along > 1 - _PARALLEL else math.inf

    def facets(self, lower: Array, upper: Array) -> Array:
        """(k, 4, 3) small faces of its surface in the box from ``lower`` to ``upper`` (3,), (3,) [m], world."""
        normal, middle = np.array(self.unit_normal), (lower + upper) / 2
        foot = middle - (middle @ normal - self.offset) * normal
        u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        u *= float(np.linalg.norm(upper - lower)) / 2 / np.linalg.norm(u)
        faces = rectangle(foot, u, np.cross(normal, u), _PATCH_PIECES)
        inside = np.all((faces >= lower - 1e-9) & (faces <= upper + 1e-9), axis=(1, 2))
        return np.asarray(faces[inside])

    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        """Heights of both ends of a capsule over the surface [m]."""
        return half_space_bounds(start, along, self.unit_normal, self.offset, radius)
