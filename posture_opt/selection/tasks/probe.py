"""Task ``probe``: touch a surface: the spread along the direction counts."""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.selection.tasks.task import Task
from posture_opt.uncertainty.clearance import Within


class Probe(Task):
    """Touching along ``direction``: the standard deviation along it is made small."""

    within: ClassVar[Within] = "along"
    axis: ClassVar[Literal["aligned", "required", "free"]] = "aligned"
    summary: ClassVar[str] = "touch a surface: the spread along the direction counts."
    direction_name: ClassVar[str] = "probing direction"

    kind: Literal["probe"]
