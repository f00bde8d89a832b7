"""The tasks: one file each, listed here; a file is read when its task is asked for, by its kind or its class.

The names of the tasks alone, as the completion of a word in a shell needs them, load no library.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from posture_opt.selection.tasks.task import Criterion, Region, Task

    TASKS: tuple[type[Task], ...]

# The kinds of `TASKS`; a kind is the name of its file, and in capitals of its class.
KINDS = ("insert", "drill", "probe", "measure", "trace", "weld", "dispense", "place", "hold", "custom")


def task_class(kind: str) -> type[Task] | None:
    """The class of a kind, or None; only its file is imported, as the others cost a cold command milliseconds."""
    if kind not in KINDS:
        return None
    found: type[Task] = getattr(import_module(f"posture_opt.selection.tasks.{kind}"), kind.capitalize())
    return found


def __getattr__(name: str) -> Any:
    if name == "TASKS":
        globals()[name] = tuple(map(task_class, KINDS))
    elif name in ("Criterion", "Region", "Task"):
        globals()[name] = getattr(import_module("posture_opt.selection.tasks.task"), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals()[name]


def known_to(kind: str | None, keys: Mapping[str, Any], tasks: Sequence[type[Task]]) -> dict[str, Any]:
    """The ``keys`` of a section ``task`` that another kind has too, or that no task knows: those are refused."""
    for task in tasks:
        if task.model_fields["kind"].annotation.__args__[0] == kind:  # type: ignore[union-attr]
            return {
                key: value
                for key, value in keys.items()
                if key in task.model_fields or not any(key in task.model_fields for task in tasks)
            }
    return dict(keys)


__all__ = ["KINDS", "TASKS", "Criterion", "Region", "Task", "known_to", "task_class"]
