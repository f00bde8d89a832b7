"""The ``cell`` section of the problem file: what is around the arm, and how near it may come."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field, field_validator

from posture_opt.collision.mounting import MOUNTING_PLANE, MountingSpec
from posture_opt.collision.obstacles import Obstacle, ObstacleSpec
from posture_opt.collision.obstacles.mesh import Mesh
from posture_opt.collision.planning_scene import scene_obstacles
from posture_opt.errors import BadValueError, InputError, Issue
from posture_opt.limits import MOST_OBSTACLES
from posture_opt.spec import WordOrSection
from posture_opt.units import Length


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
