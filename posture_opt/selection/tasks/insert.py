"""Task ``insert``: centre a peg on a hole: the spread across the direction counts, the depth does not."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.selection.tasks.task import Criterion, Task
from posture_opt.uncertainty.task_spread import Within


class Insert(Task):
    """Insertion along ``direction``: the worst axis of the spread across it is made small."""

    within: ClassVar[Within] = "across"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "aligned"
    summary: ClassVar[str] = "centre a peg on a hole: the spread across the direction counts, the depth does not."

    kind: Literal["insert"]
    criterion: Criterion = "worst"
