"""Tasks that other installed packages bring, by the entry point group ``posture_opt.tasks``."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, get_args

from posture_opt.selection import tasks as own
from posture_opt.selection.tasks import Task

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "posture_opt.tasks"


@dataclass(frozen=True)
class BrokenTask:
    """A task that is registered and cannot be used: its name, the package that registers it, and why not."""

    name: str
    package: str
    reason: str

    def __str__(self) -> str:
        return f"the task '{self.name}' of the package {self.package} cannot be used: {self.reason}"


@dataclass(frozen=True)
class RegisteredTasks:
    """Usable classes of installed packages, and defects of the others."""

    tasks: tuple[type[Task], ...] = ()
    broken: tuple[BrokenTask, ...] = ()


@cache
def registered_tasks() -> RegisteredTasks:
    """The tasks of all installed packages, found once in a process."""
    metadata = import_module("importlib.metadata")  # brings Python's reader of e-mails, and most files need none of it
    return read_tasks(metadata.entry_points(group=GROUP))


@cache
def every_task() -> tuple[type[Task], ...]:
    """Tasks of this package, then those of others."""
    return (*own.TASKS, *registered_tasks().tasks)


def read_tasks(points: Iterable[EntryPoint]) -> RegisteredTasks:
    """The classes that entry points name; one that cannot be loaded or is no task does not disturb the others."""
    tasks: list[type[Task]] = []
    broken = []
    taken = {kind_of(task) for task in own.TASKS}
    for point in sorted(points, key=lambda point: (point.name, point.value)):
        try:
            task = _checked(point.load(), point.name, taken)
        except (Exception, SystemExit) as error:  # code of others may raise anything, and end the program
            reason = str(error) if isinstance(error, TypeError) else f"{type(error).__name__}: {error}"
            broken.append(
                BrokenTask(
                    point.name, point.dist.name if point.dist is not None else point.value.partition(".")[0], reason
                )
            )
            continue
        taken.add(kind_of(task))
        tasks.append(task)
    return RegisteredTasks(tuple(tasks), tuple(broken))


def kind_of(task: type[Task]) -> str:
    (kind,) = get_args(task.model_fields["kind"].annotation)
    return str(kind)


def direction_name(kind: str) -> str:
    """What reports call the direction of a task of that kind: insertion direction."""
    task = own.task_class(kind)
    return (task or next((t for t in registered_tasks().tasks if kind_of(t) == kind), Task)).direction_name


def part_words(within: str, kind: str) -> str:
    """The part of the spread that a task of that kind counts: across the insertion direction."""
    return "in space" if within == "all" else f"{within} the {direction_name(kind)}"


def _checked(found: object, name: str, taken: set[str]) -> type[Task]:
    if not (isinstance(found, type) and issubclass(found, Task)):
        raise TypeError(f"{found!r} is no subclass of posture_opt.Task")
    if get_args(found.model_fields["kind"].annotation) != (name,):
        raise TypeError(f'its class does not say kind: Literal["{name}"]')
    if name in taken:
        raise TypeError("a task of that kind is there already; choose another kind")
    missing = [
        word for word in ("within", "axis", "summary") if not hasattr(found, word) and word not in found.model_fields
    ]
    if missing:
        raise TypeError(f"its class does not say {', '.join(missing)}")
    found.model_json_schema()  # keys that cannot be described cannot be read either
    return found
