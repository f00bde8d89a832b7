"""The ``cell`` section of the problem file: what is around the arm, and how near it may come."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, GetJsonSchemaHandler, field_validator, model_validator
from pydantic_core import CoreSchema

from posture_opt.collision.mounting import MOUNTING_PLANE, MountingSpec
from posture_opt.collision.obstacles import Obstacle, ObstacleSpec
from posture_opt.errors import BadValueError
from posture_opt.numerics import Json
from posture_opt.spec import Spec
from posture_opt.units import Length


class CellSpec(Spec):
    """Obstacles in the world frame, and the least distance to keep; ``cell: none`` checks no collisions at all."""

    obstacles: tuple[ObstacleSpec, ...] = Field((), description="what is around the arm, world frame")
    clearance: Annotated[Length, Field(ge=0)] = Field(
        0.0, description="least distance of the arm to the obstacles, and of links that are not neighbours"
    )
    """Least distance [m]; zero allows contact."""
    mounting: MountingSpec | None = Field(
        None, description="the surface that the arm stands on; default: through its base, where its shape is known"
    )
    checked: bool = Field(True, description="false, as cell: none, leaves all collisions unchecked")

    @model_validator(mode="before")
    @classmethod
    def _expanded_word(cls, value: object) -> object:
        """The word ``none`` as the section that it abbreviates.

        Raises:
            BadValueError: any other word.
        """
        if isinstance(value, str):
            if value.strip() != "none":
                raise BadValueError(f"'{value}' is no cell", "write none or {obstacles: [...], clearance: 20 mm}")
            return {"checked": False}
        return value

    @field_validator("obstacles")
    @classmethod
    def _named_once(cls, obstacles: tuple[Obstacle, ...]) -> tuple[Obstacle, ...]:
        """The obstacles as they are, if their names differ: reports and solver rows are named after them.

        Raises:
            BadValueError: two of one name.
        """
        names = [obstacle.name for obstacle in obstacles]
        for name in dict.fromkeys(names):
            if names.count(name) > 1:
                raise BadValueError(f"{names.count(name)} obstacles are called '{name}'", "give each a name of its own")
        if MOUNTING_PLANE in names:
            message = f"no obstacle can be called '{MOUNTING_PLANE}'"
            raise BadValueError(message, "state it by mounting: {below: 0 mm}, or choose another name")
        return obstacles

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Json]:
        """The schema of the section, or the word ``none``."""
        return {"anyOf": [handler(schema), {"const": "none"}]}
