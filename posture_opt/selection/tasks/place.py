"""Task ``place``: put a part down: the mean square miss across the direction counts."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.selection.tasks.task import Criterion, Task
from posture_opt.uncertainty.critical import Within


class Place(Task):
    """Putting a part down along ``direction``: the mean square distance across it is made small."""

    within: ClassVar[Within] = "across"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "aligned"
    summary: ClassVar[str] = "put a part down: the mean square miss across the direction counts."

    kind: Literal["place"]
    criterion: Criterion = "trace"
