"""``SeamTask``: a tool that is led along a seam, its axis towards it, some way off."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from posture_opt.errors import BadValueError
from posture_opt.selection.tasks.path_task import PathTask, Point
from posture_opt.uncertainty.regions.critical import Within
from posture_opt.units import Length


class SeamTask(PathTask):
    """A path with the tool axis along its own axes, or along ``direction`` where it states none, within the tilt.

    The spread counts across the travel, sideways and in the distance from the seam alike: both change the bead.
    """

    within: ClassVar[Within] = "across"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "aligned"

    standoff: Annotated[Length, Field(ge=0)] = Field(
        0.0, description="distance of the tool point from the path, against the direction"
    )

    @property
    def tool_points(self) -> tuple[Point, ...]:
        """Where the tool point goes: off the seam by the stand-off, against the tool axis."""
        points = super().tool_points
        if not self.standoff:
            return points
        axes = self.unit_axes
        return tuple(
            (x - self.standoff * dx, y - self.standoff * dy, z - self.standoff * dz)
            for (x, y, z), (dx, dy, dz) in zip(points, axes, strict=True)
        )

    @model_validator(mode="after")
    def _needs_a_seam(self) -> SeamTask:
        if not self.on_path:
            raise BadValueError(
                f"{self.kind} follows a seam and none is given",
                "add path: seam.csv, or points: [[0.5 m, 0 m, 0.1 m], [0.6 m, 0 m, 0.1 m]]",
            )
        return self
