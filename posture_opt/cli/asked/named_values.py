"""Values of options and arguments that are one of known names, or a file, and what completes them in a shell."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from posture_opt.files import builtin_names, preset_names
from posture_opt.selection.tasks import KINDS

if TYPE_CHECKING:
    Text = click.ParamType[Any]
    Completed = list[CompletionItem[Any]]
else:
    Text = click.ParamType  # generic from click 8.4 on

FILE = "file"
"""What an item of a completion is that names a file or a folder, as ``CompletionItem.kind`` states it."""


@dataclass(frozen=True)
class Named(Text):
    """A text that may be one of some names; whether it is one, the command itself says, with a hint.

    Args:
        names: those known, asked for where a word is completed.
        endings: of files that may be named in place of them; none where a file is no answer.
    """

    names: Callable[[], Iterable[str]]
    endings: tuple[str, ...] = ()
    name = "text"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The text as it is."""
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> Completed:
        """The names that begin so, and the files."""
        names = [CompletionItem(name) for name in self.names() if name.startswith(incomplete)]
        return names + (completed_files(incomplete, self.endings) if self.endings else [])


def completed_files(begun: str, endings: tuple[str, ...] = (), *, folders: bool = False) -> Completed:
    """The files and folders whose path begins so, files with one of the ``endings`` or none but ``folders``.

    A folder that is the only one is looked into: a shell would put a space behind it, as behind every whole word.
    """
    place, _, start = begun.rpartition("/")
    inside = Path(f"{place}/").expanduser() if place or begun.startswith("/") else Path()
    try:
        entries = sorted(entry for entry in inside.iterdir() if entry.name.startswith(start))
    except OSError:
        return []
    shown = [entry for entry in entries if start or not entry.name.startswith(".")]
    root = begun[: len(begun) - len(start)]
    there = [f"{root}{entry.name}/" for entry in shown if entry.is_dir()]
    files = [] if folders else [f"{root}{e.name}" for e in shown if not e.is_dir() and e.name.endswith(endings or "")]
    if len(there) == 1 and not files and (deeper := completed_files(there[0], endings, folders=folders)):
        return deeper if not folders else [CompletionItem(there[0], kind=FILE), *deeper]
    return [CompletionItem(path, kind=FILE) for path in sorted([*there, *files])]


def _tasks() -> Iterable[str]:
    """The tasks of this package, and those that other packages register, whose code is not loaded."""
    points = import_module("importlib.metadata").entry_points(group="posture_opt.tasks")
    return dict.fromkeys((*KINDS, *(point.name for point in points)))


PROBLEM = Named(builtin_names, (".yaml", ".yml"))
ROBOT = Named(preset_names, (".urdf", ".xml", ".yaml", ".yml"))
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

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> Completed:
        """Files as the help calls them: folders of DIR, tables of DATA.csv, all of FILE."""
        named = f"{param.metavar or ''}".lower()
        return completed_files(incomplete, (".csv",) if named.endswith(".csv") else (), folders=named == "dir")


PATH = NamedPath(path_type=Path)
