"""Task ``insert``: centre a peg on a hole: the spread across the direction counts, the depth does not."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from posture_opt.errors import BadValueError
from posture_opt.selection.tasks.task import Task
from posture_opt.uncertainty.clearance import Within
from posture_opt.uncertainty.peg_spread import HeldPart
from posture_opt.units import Length

Positive = Annotated[Length, Field(gt=0)]


class Insert(Task):
    """Insertion along ``direction`` d: the worst axis of the spread across it is made small, ``λ_max(Bᵀ C B)``.

    B (3, 2) is an orthonormal complement of d: an error along d changes the depth alone. With the ``length`` of the
    peg the tilt counts too: the peg's tip is the tool point, its body goes back along the tool axis, and the worse of
    its two ends is what is made small. ``diameter`` and ``friction`` add the probability of wedging.
    """

    within: ClassVar[Within] = "across"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "aligned"
    summary: ClassVar[str] = "centre a peg on a hole: the spread across the direction counts, the depth does not."
    direction_name: ClassVar[str] = "insertion direction"

    kind: Literal["insert"]
    length: Positive | None = Field(None, description="of the peg: its tilt counts")
    diameter: Positive | None = Field(None, description="of the peg, for the probability of wedging")
    friction: float | None = Field(None, gt=0, description="between peg and hole, for the probability of wedging")

    @model_validator(mode="after")
    def _whole_peg(self) -> Insert:
        if (self.diameter is None) != (self.friction is None):
            message = "diameter and friction determine the probability of wedging together"
            raise BadValueError(message, "state both or neither")
        if self.diameter is not None and (self.length is None or self.clearance is None):
            raise BadValueError("wedging needs the length of the peg and the clearance of the hole", "add them")
        return self

    @property
    def part(self) -> HeldPart | None:
        if self.length is None:
            return None
        size = math.hypot(*self.tool_axis)
        x, y, z = self.tool_axis
        unknown = math.nan
        return HeldPart(self.length, (x / size, y / size, z / size), self.diameter or unknown, self.friction or unknown)
