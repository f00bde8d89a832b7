"""Task ``measure``: locate a point in space: the whole spread counts."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.selection.tasks.task import Criterion, Task
from posture_opt.uncertainty.critical import Within


class Measure(Task):
    """Measuring a point: the total variance of the tool point is made small."""

    within: ClassVar[Within] = "all"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "free"
    summary: ClassVar[str] = "locate a point in space: the whole spread counts."

    kind: Literal["measure"]
    criterion: Criterion = "trace"
