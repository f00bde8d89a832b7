"""The tasks: one file each, listed here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.selection.tasks.drill import Drill
from posture_opt.selection.tasks.insert import Insert
from posture_opt.selection.tasks.measure import Measure
from posture_opt.selection.tasks.place import Place
from posture_opt.selection.tasks.probe import Probe
from posture_opt.selection.tasks.task import Criterion, Region, Task
from posture_opt.selection.tasks.trace import Trace
from posture_opt.spec import one_of

TASKS: tuple[type[Task], ...] = (Insert, Drill, Probe, Measure, Trace, Place)

if TYPE_CHECKING:
    TaskSpec = Task
else:
    TaskSpec = one_of(TASKS)

__all__ = ["TASKS", "Criterion", "Region", "Task", "TaskSpec"]
