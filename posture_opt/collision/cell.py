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
    """The plane that links behind the first, tool and held part stay above."""

    below: float  # distance [m] of the plane below the xy plane of the base, along its z axis
    assumed: bool = False  # whether the problem states nothing of it
    dropped: bool = False  # whether it was assumed and given up, as the task cannot be done above it

    @classmethod
    def of(cls, robot: Robot, stated: MountingSpec | None, obstacles: tuple[Obstacle, ...]) -> Mounting | None:
        """The stated plane; else the foot of an arm of known shape that stands on no obstacle; else None."""
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
        """Its statement where it is assumed; ``depth`` [m] of the arm below it."""
        place = f"{stated_length(self.below)} below the base frame" if self.below else "at its base"
        if self.dropped and depth > 5e-4:  # less is none in whole millimetres
            return state("collision.mounting-dropped", depth=Quantity(depth), place=place)
        return state("collision.mounting-assumed", place=place) if self.assumed else None

    def to_json(self) -> dict[str, Json]:
        return dict(vars(self))


def base_frame(robot: Robot) -> tuple[Array, Array]:
    """Origin (3,) [m] and z axis (3,) of the base, world."""
    reached = walk(robot.base, [factor.nominal for factor in robot.base])
    return np.array(reached.position, dtype=float), np.array(reached.columns[2], dtype=float)


def below_base(placed: PlacedCapsules, Q: Array) -> Statement | None:
    """Which link's end lies lowest below the base's xy plane at Q (N, n); None where tool or first link do too."""
    origin, normal = base_frame(placed.robot)
    least = ((placed.origins(Q) - origin) @ normal).min(axis=0)
    lowest = int(np.argmin(least[1:-1]))
    # A base that measurements found leans by some mrad, 5 mm at the end of an arm.
    if least[lowest + 1] > -5e-3 or min(least[1], least[-1]) < -5e-3:
        return None
    return state("collision.link-below-base", placed.robot.joint_names[lowest], depth=Quantity(-least[lowest + 1]))


def carries(robot: Robot, obstacle: Obstacle) -> bool:
    """Whether an obstacle is the floor or the table that the arm stands on: below its foot, and level or near."""
    origin, normal = base_frame(robot)
    foot = origin - robot.mounting_below * normal
    # What rises higher stands beside the arm and carries nothing.
    if obstacle.extent(normal) > float(normal @ foot) + 0.05:
        return False
    if isinstance(obstacle, HalfSpace):
        return float(np.dot(obstacle.unit_normal, normal)) > 0.99  # 8 deg
    # Feet of arms of up to 30 kg are up to 0.22 m wide.
    return float(obstacle.distance(foot[None], foot[None])[0]) <= 0.25


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
        """The cell with its mesh and scene files read; InputError names every file that cannot be used."""
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
        MOST_OBSTACLES.check(len(obstacles))
        names = Counter(obstacle.name for obstacle in obstacles)
        for name, count in names.items():
            if count > 1:
                raise BadValueError(f"{count} obstacles are called '{name}'", "give each a name of its own")
        if MOUNTING_PLANE in names:
            message = f"no obstacle can be called '{MOUNTING_PLANE}'"
            raise BadValueError(message, "state it by mounting: {below: 0 mm}, or choose another name")
        return obstacles
