"""The tasks: one file each, listed here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from posture_opt.selection.tasks.custom import Custom
from posture_opt.selection.tasks.dispense import Dispense
from posture_opt.selection.tasks.drill import Drill
from posture_opt.selection.tasks.hold import Hold
from posture_opt.selection.tasks.insert import Insert
from posture_opt.selection.tasks.measure import Measure
from posture_opt.selection.tasks.place import Place
from posture_opt.selection.tasks.probe import Probe
from posture_opt.selection.tasks.task import Criterion, Region, Task
from posture_opt.selection.tasks.trace import Trace
from posture_opt.selection.tasks.weld import Weld

TASKS: tuple[type[Task], ...] = (Insert, Drill, Probe, Measure, Trace, Weld, Dispense, Place, Hold, Custom)


def known_to(kind: str | None, keys: Mapping[str, Any], tasks: Sequence[type[Task]] = TASKS) -> dict[str, Any]:
    """Those ``keys`` of a section ``task`` that a task of another kind has too; all of them where there is none."""
    for task in tasks:
        if task.model_fields["kind"].annotation.__args__[0] == kind:  # type: ignore[union-attr]
            return {key: value for key, value in keys.items() if key in task.model_fields or not _of_any(tasks, key)}
    return dict(keys)


def _of_any(tasks: Sequence[type[Task]], key: str) -> bool:
    return any(key in task.model_fields for task in tasks)


__all__ = ["TASKS", "Criterion", "Region", "Task", "known_to"]
