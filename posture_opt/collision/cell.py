"""The ``cell`` section of the problem file: obstacles, the surface that the arm stands on, and the distance to keep."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, field_validator

from posture_opt.collision.obstacles import Obstacle, ObstacleSpec
from posture_opt.collision.obstacles.half_space import HalfSpace
from posture_opt.collision.obstacles.mesh import Mesh
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.collision.planning_scene import scene_obstacles
from posture_opt.errors import BadValueError, InputError, Issue
from posture_opt.limits import MOST_OBSTACLES
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


class CellSpec(WordOrSection):
    """Obstacles in the world frame, and the least distance to keep; ``cell: none`` checks no collisions at all."""

    word: ClassVar[str] = "none"
    meaning: ClassVar[Mapping[str, object]] = {"checked": False}
    noun: ClassVar[str] = "cell"
    example: ClassVar[str] = "{obstacles: [...], clearance: 20 mm}"

    obstacles: tuple[ObstacleSpec, ...] = Field((), description="what is around the arm, world frame")
    clearance: Annotated[Length, Field(ge=0)] = Field(
        0.0, description="least distance of the arm to the obstacles, and of links that are not neighbours"
    )
    """Least distance [m]; zero allows contact."""
    mounting: MountingSpec | None = Field(
        None, description="the surface that the arm stands on; default: through its base, where its shape is known"
    )
    scene: str | None = Field(
        None, description="MoveIt's planning scene, a .scene file, whose objects are obstacles too"
    )
    checked: bool = Field(True, description="false, as cell: none, leaves all collisions unchecked")

    def in_folder(self, folder: Path) -> CellSpec:
        """The same cell with the files of its meshes and of its planning scene read.

        Args:
            folder: where relative file names start.

        Raises:
            InputError: every file that cannot be used, by its key from the top of the problem file.
        """
        issues: list[Issue] = []
        obstacles: list[Obstacle] = []
        for k, obstacle in enumerate(self.obstacles):
            try:
                obstacles.append(obstacle.in_folder(folder) if isinstance(obstacle, Mesh) else obstacle)
            except InputError as error:
                issues += [issue.at("cell", "obstacles", k) for issue in error.issues]
        try:
            further = () if self.scene is None else scene_obstacles(folder, self.scene)
        except InputError as error:
            issues += [issue.at("cell") for issue in error.issues]
        if issues:
            raise InputError(issues)
        taken = {obstacle.name for obstacle in obstacles}
        renamed = (o.model_copy(update={"name": f"{o.name} (scene)"}) if o.name in taken else o for o in further)
        return self.model_copy(update={"obstacles": (*obstacles, *renamed)})

    @property
    def notes(self) -> tuple[str, ...]:
        """How its meshes are checked."""
        return tuple(obstacle.note for obstacle in self.obstacles if isinstance(obstacle, Mesh))

    @field_validator("obstacles")
    @classmethod
    def _named_once(cls, obstacles: tuple[Obstacle, ...]) -> tuple[Obstacle, ...]:
        """The obstacles as they are, if their names differ: reports and solver rows are named after them.

        Raises:
            BadValueError: two of one name, or too many.
        """
        MOST_OBSTACLES.check(len(obstacles))
        names = Counter(obstacle.name for obstacle in obstacles)
        for name, count in names.items():
            if count > 1:
                raise BadValueError(f"{count} obstacles are called '{name}'", "give each a name of its own")
        if MOUNTING_PLANE in names:
            message = f"no obstacle can be called '{MOUNTING_PLANE}'"
            raise BadValueError(message, "state it by mounting: {below: 0 mm}, or choose another name")
        return obstacles
