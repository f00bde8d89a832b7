"""Task ``drill``: as insert, but the arm must be able to point the tool along the direction."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.selection.tasks.task import Task
from posture_opt.uncertainty.clearance import Within


class Drill(Task):
    """Drilling along ``direction``: as insertion, with the tool axis required to lie along it.

    An arm that cannot point its tool along the direction is refused, where ``insert`` reports the axis as
    unconstrained.
    """

    within: ClassVar[Within] = "across"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "required"
    summary: ClassVar[str] = "as insert, but the arm must be able to point the tool along the direction."
    direction_name: ClassVar[str] = "drilling direction"

    kind: Literal["drill"]
