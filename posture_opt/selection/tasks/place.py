"""Task ``place``: put a part down: the mean square miss across the direction counts."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from posture_opt.errors import BadValueError
from posture_opt.selection.tasks.task import Criterion, Task
from posture_opt.uncertainty.clearance import Within
from posture_opt.units import Angle, Length


class Place(Task):
    """Putting a part down along ``direction``: the mean square distance across it is made small.

    With the ``lever`` of the part, from the tool point to its farthest corner, the yaw counts in one unit with the
    place: a corner is off by the shift and by lever × yaw, so that its mean square error is
    ``E|e|² + lever² Var(yaw)``, averaged over all corners.
    """

    within: ClassVar[Within] = "across"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "aligned"
    summary: ClassVar[str] = "put a part down: the mean square miss across the direction counts, with a lever the yaw."
    direction_name: ClassVar[str] = "placing direction"

    kind: Literal["place"]
    criterion: Criterion = "trace"
    lever: Annotated[Length, Field(gt=0)] | None = Field(
        None, description="from the tool point to the farthest corner of the part: the yaw counts"
    )

    yaw: Angle | None = Field(None, description="of the tool's x axis about the world's z; left out, it is free")

    @model_validator(mode="after")
    def _yaw_is_about_the_vertical(self) -> Place:
        if self.yaw is None:
            return self
        upright = math.hypot(*self.direction[:2]) < 1e-9 * math.hypot(*self.direction)
        if not upright or math.hypot(*self.tool_axis[:2]) > 0:
            hint = "direction: [0, 0, -1] and tool_axis: [0, 0, 1], or leave out the yaw"
            raise BadValueError("a yaw is one about the vertical, along direction and tool axis", hint)
        if self.tilt:
            raise BadValueError("yaw and tilt are both given", "leave out one of them")
        return self

    @property
    def heading(self) -> tuple[float, float, float] | None:
        return None if self.yaw is None else (math.cos(self.yaw), math.sin(self.yaw), 0.0)

    @model_validator(mode="after")
    def _lever_goes_with_lengths(self) -> Place:
        if self.lever is not None and self.criterion == "miss":
            raise BadValueError("criterion miss asks about the tool point, not about corners", "leave out the lever")
        return self

    @property
    def yaw_lever(self) -> float:
        return self.lever or 0.0

    @property
    def uses_yaw(self) -> bool:
        return True
