"""``cell.mounting``: the surface that an arm stands on, as a plane below its base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from posture_opt.collision.obstacles import Obstacle
from posture_opt.collision.obstacles.half_space import HalfSpace
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.model.chain import walk
from posture_opt.numerics import Array, Json
from posture_opt.robot.robot import Robot
from posture_opt.spec import WordOrSection
from posture_opt.statements import Quantity, Statement, state
from posture_opt.statements.notation import stated_length
from posture_opt.units import Length

MOUNTING_PLANE = "mounting plane"
"""Name of the plane in reports and rows; no obstacle may have it."""
_STANDING_RISE_M = 0.05
"""What rises higher than this [m] above the foot of the arm stands beside it and carries nothing."""
_STANDING_REACH_M = 0.25
"""An obstacle below the foot of the arm and within this distance [m] of it is the table that it stands on: the feet of
arms of up to 30 kg are up to 0.22 m wide, and tables begin a little in front of some."""
_BELOW_BASE_M = 5e-3
"""Links of unknown shape that end deeper [m] below the xy plane of the base are worth a sentence: a base that
measurements found leans by some mrad, 5 mm at the end of an arm."""
_LEVEL = 0.99
"""Cosine from which a half-space counts as parallel to the mounting plane (8 deg)."""


class MountingSpec(WordOrSection):
    """The plane that lies ``below`` the xy plane of the arm's base; the word ``none`` for an arm without one."""

    word: ClassVar[str] = "none"
    meaning: ClassVar[Mapping[str, object]] = {"below": None}
    noun: ClassVar[str] = "mounting"
    example: ClassVar[str] = "{below: 750 mm}"

    below: Length | None = Field(0.0, description="distance of the plane below the base's own xy plane")
    """[m]; None: nothing is below the arm that it could hit."""


@dataclass(frozen=True)
class Mounting:
    """The plane that links behind the first, tool and held part stay above.

    Args:
        below: distance [m] of the plane below the xy plane of the base, along its z axis.
        assumed: whether the problem states nothing of it.
        dropped: whether it was assumed and given up, as the task cannot be done above it.
    """

    below: float
    assumed: bool = False
    dropped: bool = False

    @classmethod
    def of(cls, robot: Robot, stated: MountingSpec | None, obstacles: tuple[Obstacle, ...]) -> Mounting | None:
        """The plane that is stated; else, for an arm of known shape that stands on none of the obstacles, the foot.

        None where there is none. What an arm of unknown shape is mounted on is not known either.

        Args:
            robot: with its base in the world.
            stated: the key ``mounting`` of the cell.
            obstacles: in the world.
        """
        if stated is not None:
            return None if stated.below is None else cls(stated.below)
        if not robot.links_have_shape or any(carries(robot, obstacle) for obstacle in obstacles):
            return None
        return cls(robot.mounting_below, assumed=True)

    def plane(self, robot: Robot) -> HalfSpace:
        """The plane in the world; it moves with the base of the robot."""
        origin, normal = base_frame(robot)
        x, y, z = (np.round(normal, 15) + 0.0).tolist()
        offset = round(float(normal @ origin) - self.below, 15) + 0.0
        return HalfSpace(name=MOUNTING_PLANE, kind="half_space", normal=(x, y, z), offset=f"{offset} m")

    def statement(self, depth: float) -> Statement | None:
        """What the reader of an answer has to know of it; None of a plane that is stated.

        Args:
            depth: how far the arm reaches below the plane [m].
        """
        if self.dropped:
            return state("collision.mounting-dropped", depth=Quantity(depth), place=self._height)
        return state("collision.mounting-assumed", place=self._height) if self.assumed else None

    @property
    def _height(self) -> str:
        """Where the plane is."""
        return f"{stated_length(self.below)} below the base frame" if self.below else "at its base"

    def to_json(self) -> dict[str, Json]:
        """The key ``mounting`` of a document."""
        return {"below": self.below, "assumed": self.assumed, "dropped": self.dropped}


def base_frame(robot: Robot) -> tuple[Array, Array]:
    """Origin (3,) [m] and z axis (3,) of the base, world."""
    reached = walk(robot.base, [factor.nominal for factor in robot.base])
    return np.array(reached.position, dtype=float), np.array(reached.columns[2], dtype=float)


def below_base(placed: PlacedCapsules, Q: Array) -> Statement | None:
    """Which link ends lowest below the xy plane of the base, where nothing says what the arm stands on; else None.

    Links are points here: their ends. That a tool point, or the end of the first link, is below the plane tells that
    the arm does not stand on it.

    Args:
        Q: (N, n) postures [rad or m].
    """
    origin, normal = base_frame(placed.robot)
    heights = (placed.origins(Q) - origin) @ normal
    least = heights.min(axis=0)
    lowest = int(np.argmin(least[1:-1]))
    if least[lowest + 1] > -_BELOW_BASE_M or min(least[1], least[-1]) < -_BELOW_BASE_M:
        return None
    return state("collision.link-below-base", placed.robot.joint_names[lowest], depth=Quantity(-least[lowest + 1]))


def carries(robot: Robot, obstacle: Obstacle) -> bool:
    """Whether an obstacle is the floor or the table that the arm stands on: below its foot, and level or near."""
    origin, normal = base_frame(robot)
    foot = origin - robot.mounting_below * normal
    if obstacle.extent(normal) > float(normal @ foot) + _STANDING_RISE_M:
        return False
    if isinstance(obstacle, HalfSpace):
        return float(np.dot(obstacle.unit_normal, normal)) > _LEVEL
    return float(obstacle.distance(foot[None], foot[None])[0]) <= _STANDING_REACH_M
