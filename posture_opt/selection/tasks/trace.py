"""Task ``trace``: follow a line: the spread across the direction of travel counts, the tool axis is free."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.selection.tasks.task import Criterion, Task
from posture_opt.uncertainty.task_spread import Within


class Trace(Task):
    """Passing a point along ``direction``, the direction of travel: the spread across it is made small."""

    within: ClassVar[Within] = "across"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "free"
    summary: ClassVar[str] = "follow a line: the spread across the direction of travel counts, the tool axis is free."

    kind: Literal["trace"]
    criterion: Criterion = "worst"
