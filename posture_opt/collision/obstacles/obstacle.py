"""``Obstacle``: a solid in the world; a ``PlacedObstacle`` has a frame of its own."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, ClassVar, Self

import casadi as ca
import numpy as np
from pydantic import AfterValidator, Field

from posture_opt.collision.product_solid import ProductSolid
from posture_opt.errors import BadValueError
from posture_opt.model.chain import walk
from posture_opt.numerics import Array
from posture_opt.robot.robot import frame_factors
from posture_opt.spec import Spec
from posture_opt.units import Angle, Length

Side = Annotated[Length, Field(gt=0)]
"""A length greater than zero [m]."""
Size = float | ca.SX
"""A length [m] as a number or as a symbol."""
Points = tuple[ca.SX, ca.SX]
"""Start (3,) of a segment and the vector (3,) to its end [m]."""


def _given_name(name: str) -> str:
    """The name as it is.

    Raises:
        BadValueError: it is empty or blank.
    """
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
        """The same solid as a product of balls, world; of a union that of each of its `parts`."""
        raise NotImplementedError

    @property
    def parts(self) -> tuple[Obstacle, ...]:
        """The convex solids, each a product, whose union it is."""
        return (self,)

    @abstractmethod
    def distance(self, start: Array, end: Array) -> Array:
        """(...) exact distance of segments to the solid [m]; zero or less where they touch it.

        Args:
            start, end: (..., 3) ends of the segments [m], world.
        """

    @abstractmethod
    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        """Smooth expressions whose least is a lower bound of the distance of a capsule [m].

        Args:
            start, along: (3,) where its segment starts and the vector to its end, world [m].
            length: of the segment; ``radius`` of the capsule [m].
        """

    @abstractmethod
    def smaller(self, by: Size) -> Self:
        """The same solid with every face ``by`` [m] farther in; a symbol gives one whose `bounds` are expressions of
        it.
        """

    @property
    @abstractmethod
    def half_thickness(self) -> float:
        """By how much [m] it can be made smaller before nothing of it is left."""

    @abstractmethod
    def moved(self, shift: Sequence[Size]) -> Self:
        """The same solid shifted by (3,) [m], world; symbols give one whose `bounds` are expressions of them."""

    @abstractmethod
    def extent(self, direction: Array) -> float:
        """Greatest coordinate of its points along a unit vector (3,), world [m]; infinite where it is endless."""

    @abstractmethod
    def facets(self, lower: Array, upper: Array) -> Array:
        """(k, 4, 3) small faces of its surface [m], world, for drawing.

        Args:
            lower, upper: (3,) corners of the box that is drawn [m]; of an endless solid the faces in it.
        """


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
        """The same solid with its origin shifted by (3,) [m], world."""
        return self.model_copy(update={"xyz": tuple(x + d for x, d in zip(self.xyz, shift, strict=True))})

    @property
    def placed(self) -> Array:
        """(4, 4) T_world_obstacle, lengths in [m]."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.rotation, self.xyz
        return T
