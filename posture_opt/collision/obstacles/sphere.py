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
    xyz: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)

    def distance(self, start: Array, end: Array) -> Array:
        return to_point(start, end, np.array(self.xyz)) - self.radius

    def facets(self, lower: Array, upper: Array) -> Array:
        return capsule_facets(np.array(self.xyz), np.array(self.xyz), self.radius)

    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        return [point_bound(start, along, length, self.xyz, radius + self.radius)]
