"""``Obstacle``: a solid in the world, as a product of balls; a ``PlacedObstacle`` has a frame of its own."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, ClassVar, NamedTuple, Self

import casadi as ca
import numpy as np
from pydantic import AfterValidator, Field

from posture_opt.errors import BadValueError
from posture_opt.model.chain import walk
from posture_opt.numerics import Array
from posture_opt.robot.robot import frame_factors
from posture_opt.spec import Spec
from posture_opt.units import Angle, Length

FREE = -1
"""Group of a coordinate that bounds nothing."""
LEAST_LENGTH_M = 1e-9
"""A vector shorter than this [m] has no direction."""


class ProductSolid(NamedTuple):
    """A solid as a product of balls."""

    rotation: Array  # (3, 3) R_world_solid; origin: (3,) [m], world
    origin: Array
    group: tuple[int, int, int]  # (3,) the ball of each coordinate, `FREE` for none
    size: tuple[float, float, float]  # (3,) radius of each ball [m]
    one_sided: bool = False  # whether the only ball is a half-line

    @property
    def bounding_radius(self) -> float:
        """Radius [m] about the origin that holds it; infinite where none does."""
        if self.one_sided or FREE in self.group:
            return math.inf
        return math.sqrt(sum(self.size[g] ** 2 for g in set(self.group)))

    @property
    def numbers(self) -> list[float]:
        """(20,) all of it, row by row."""
        return [*self.rotation.ravel(), *self.origin, *self.group, *self.size, self.one_sided, self.bounding_radius]


"""C text of the same for one point; ``solid`` are the ``numbers``."""
SIZE = 20
"""Numbers of a solid."""


Side = Annotated[Length, Field(gt=0)]
"""A length greater than zero [m]."""
Size = float | ca.SX
"""A length [m] as a number or as a symbol."""
Points = tuple[ca.SX, ca.SX]
"""Start (3,) of a segment and the vector (3,) to its end [m]."""


def _given_name(name: str) -> str:
    if not name.strip():
        raise BadValueError("an obstacle needs a name, by which reports speak of it", "write for example name: table")
    return name


class Obstacle(Spec):
    """A convex solid at rest, in the world frame."""

    summary: ClassVar[str]
    """One line for ``optimize-posture list``."""

    name: Annotated[str, AfterValidator(_given_name)] = Field(description="in reports, unique")
    kind: str

    @property
    def product(self) -> ProductSolid:
        """The solid as a product of balls, world; of a union that of each of its `parts`."""
        raise NotImplementedError

    @property
    def parts(self) -> tuple[Obstacle, ...]:
        """Convex solids, each a product, whose union it is."""
        return (self,)

    @abstractmethod
    def distance(self, start: Array, end: Array) -> Array:
        """(...) exact distance of segments from (..., 3) to (..., 3) [m], world; zero or less where they touch."""

    @abstractmethod
    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        """Smooth lower bounds [m] of the distance of a capsule: its start (3,), vector to its end (3,) [m], world."""

    @abstractmethod
    def smaller(self, by: Size) -> Self:
        """The solid with every face ``by`` [m] farther in; `bounds` may be expressions of a symbol."""

    @property
    @abstractmethod
    def half_thickness(self) -> float:
        """By how much [m] it can be made smaller before nothing of it is left."""

    @abstractmethod
    def moved(self, shift: Sequence[Size]) -> Self:
        """The solid shifted by (3,) [m], world; `bounds` may be expressions of symbols."""

    @abstractmethod
    def extent(self, direction: Array) -> float:
        """Greatest coordinate of its points along a unit vector (3,), world [m]; infinite where it is endless."""

    @abstractmethod
    def facets(self, lower: Array, upper: Array) -> Array:
        """(k, 4, 3) small faces [m] for a drawing of the box from (3,) to (3,) [m], world."""


class PlacedObstacle(Obstacle):
    """An obstacle with a frame: ``T = Trans(x, y, z) Rz(yaw) Ry(pitch) Rx(roll)`` in the world."""

    xyz: tuple[Length, Length, Length] = Field((0.0, 0.0, 0.0), description="its middle, world")
    rpy: tuple[Angle, Angle, Angle] = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw about the fixed axes of the world, in this order"
    )

    @cached_property
    def rotation(self) -> Array:
        """(3, 3) R_world_obstacle."""
        factors = frame_factors("obstacle", (0.0, 0.0, 0.0), self.rpy)
        return np.array(walk(factors, [factor.nominal for factor in factors]).columns, dtype=float).T

    def local(self, points: Array) -> Array:
        """(..., 3) points of the world [m] in its frame."""
        return np.asarray((points - np.array(self.xyz)) @ self.rotation)

    def local_symbols(self, start: ca.SX, along: ca.SX) -> Points:
        """A segment of the world, its start (3,) and the vector to its end (3,) [m], in its frame."""
        R = ca.DM(self.rotation.T)
        return R @ (start - ca.vertcat(*self.xyz)), R @ along

    def moved(self, shift: Sequence[Size]) -> Self:
        return self.model_copy(update={"xyz": tuple(x + d for x, d in zip(self.xyz, shift, strict=True))})

    @property
    def placed(self) -> Array:
        """(4, 4) T_world_obstacle, lengths in [m]."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.rotation, self.xyz
        return T
