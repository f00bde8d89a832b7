"""Task ``measure``: locate a point in space: the whole spread counts."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from posture_opt.selection.tasks.task import Criterion, Task
from posture_opt.uncertainty.clearance import Within


class Measure(Task):
    """Measuring a point: the total variance of the tool point is made small.

    What is stated with a measured value is the expanded uncertainty ``U = k u`` (JCGM 100:2008, 6.2.1), along
    ``direction`` and in the worst direction.
    """

    within: ClassVar[Within] = "all"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "free"
    touches: ClassVar[bool] = False
    summary: ClassVar[str] = "locate a point in space: the whole spread counts."

    kind: Literal["measure"]
    criterion: Criterion = "trace"
    coverage_factor: float = Field(2.0, gt=0, description="k of the expanded uncertainty U = k u")

    @property
    def expansion(self) -> float | None:
        return self.coverage_factor
