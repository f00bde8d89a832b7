"""Obstacle ``sphere``: a lamp, or room to keep about a point."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from posture_opt.collision.facets import capsule_facets
from posture_opt.collision.obstacles.obstacle import Obstacle, Side
from posture_opt.collision.segment_distances import to_point
from posture_opt.collision.smooth_bounds import point_bound
from posture_opt.numerics import Array
from posture_opt.units import Length


class Sphere(Obstacle):
    """A ball about a point of the world."""

    summary: ClassVar[str] = "a sphere (radius) about xyz"

    kind: Literal["sphere"]
    radius: Side
    """[m]; ``xyz`` (3,) its middle [m], world."""
    xyz: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)

    def distance(self, start: Array, end: Array) -> Array:
        """(...) exact distance of segments (..., 3) [m], world; negative where they enter it."""
        return to_point(start, end, np.array(self.xyz)) - self.radius

    def facets(self, lower: Array, upper: Array) -> Array:
        """(k, 4, 3) small faces of its surface [m], world."""
        return capsule_facets(np.array(self.xyz), np.array(self.xyz), self.radius)

    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        """The distance of a capsule [m], which is smooth and exact."""
        return [point_bound(start, along, length, self.xyz, radius + self.radius)]
