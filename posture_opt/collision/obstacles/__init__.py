"""The obstacles, listed here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.collision.obstacles.half_space import HalfSpace
from posture_opt.collision.obstacles.mesh import Mesh
from posture_opt.collision.obstacles.obstacle import Obstacle
from posture_opt.collision.obstacles.solids import Box, Cylinder, Sphere
from posture_opt.spec import one_of

OBSTACLES: tuple[type[Obstacle], ...] = (Box, Cylinder, Sphere, HalfSpace, Mesh)
"""Every kind of obstacle; the key ``kind`` of an entry selects one."""

if TYPE_CHECKING:
    ObstacleSpec = Obstacle
else:
    ObstacleSpec = one_of(OBSTACLES)

__all__ = ["OBSTACLES", "Obstacle", "ObstacleSpec"]
