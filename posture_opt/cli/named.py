"""Values of options and arguments that are one of known names, or a file: what shells complete."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click

if TYPE_CHECKING:
    Text = click.ParamType[Any]
else:
    Text = click.ParamType  # generic from click 8.4 on


@dataclass(frozen=True)
class Named(Text):
    """A text that may be one of some names; whether it is one, the command itself says, with a hint.

    Args:
        names: those known, asked for where a completion script is made.
        endings: of files that may be named in place of them; none where a file is no answer.
    """

    names: Callable[[], Iterable[str]]
    endings: tuple[str, ...] = ()
    name = "text"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The text as it is."""
        return value


def _problems() -> Iterable[str]:
    """The built-in problems."""
    names: Iterable[str] = import_module("posture_opt.problem.load").builtin_names()
    return names


def _presets() -> Iterable[str]:
    """The preset robots."""
    names: Iterable[str] = import_module("posture_opt.robot").preset_names()
    return names


def _tasks() -> Iterable[str]:
    """The kinds of tasks, those of other installed packages included."""
    tasks = import_module("posture_opt.selection.registered_tasks").every_task()
    return [get_args(task.model_fields["kind"].annotation)[0] for task in tasks]


PROBLEM = Named(_problems, (".yaml", ".yml"))
ROBOT = Named(_presets, (".urdf", ".xml", ".yaml", ".yml"))
TASK = Named(_tasks)


class NamedPath(click.Path):
    """A path with a name: without one, of a shell variable that is not set, it would be the working folder."""

    def convert(self, value: str | PathLike[str], param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path.

        Raises:
            click.BadParameter: the name is empty.
        """
        if not str(value).strip():
            self.fail("the name is empty; write . for this folder", param, ctx)
        return super().convert(value, param, ctx)


PATH = NamedPath(path_type=Path)
