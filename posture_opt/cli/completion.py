"""Values of options that are one of known names, or a file, and what completes them in a shell."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import BashComplete, CompletionItem, add_completion_class, get_completion_class

from posture_opt.files import builtin_names, preset_names
from posture_opt.selection.tasks import KINDS

if TYPE_CHECKING:
    Text = click.ParamType[Any]
    Completed = list[CompletionItem[Any]]
else:
    Text = click.ParamType  # generic from click 8.4 on

FILE = "file"  # What an item of a completion is that names a file or a folder, as ``CompletionItem.kind`` states it


@dataclass(frozen=True)
class Named(Text):
    """A text that may be one of some names; whether it is one, the command itself says, with a hint."""

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
    """The files and folders whose path begins so, files with one of the ``endings`` or none but ``folders``."""
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
    points = import_module("importlib.metadata").entry_points(group="posture_opt.tasks")
    return dict.fromkeys((*KINDS, *(point.name for point in points)))


PROBLEM = Named(builtin_names, (".yaml", ".yml"))
ROBOT = Named(preset_names, (".urdf", ".xml", ".yaml", ".yml"))
TASK = Named(_tasks)


class NamedPath(click.Path):
    """A path with a name: without one, of a shell variable that is not set, it would be the working folder."""

    def convert(self, value: str | PathLike[str], param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path."""
        if not str(value).strip():
            self.fail("the name is empty; write . for this folder", param, ctx)
        return super().convert(value, param, ctx)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> Completed:
        """Files as the help calls them: folders of DIR, tables of DATA.csv, all of FILE."""
        named = f"{param.metavar or ''}".lower()
        return completed_files(incomplete, (".csv",) if named.endswith(".csv") else (), folders=named == "dir")


PATH = NamedPath(path_type=Path)


VARIABLE = "_OPTIMIZE_POSTURE_COMPLETE"  # Of the environment, by which the scripts ask for the words that may follow


class EscapingBash(BashComplete):
    """click's completion for bash, which knows the equals sign of ``--task=`` and spaces in names of files."""

    def get_completion_args(self) -> tuple[list[str], str]:
        """The words before the cursor and the one at it; bash makes the equals sign a word of its own."""
        args, incomplete = super().get_completion_args()
        return [word for word in args if word != "="], "" if incomplete == "=" else incomplete

    def format_completion(self, item: CompletionItem[Any]) -> str:
        """The item in a line; in the name of a file a backslash before what is special, and one before that."""
        if item.kind == FILE:
            special = " \t!\"#$&'()*;<>?[\\]^`{|}"
            item.value = "".join(f"\\\\{c}" if c in special else c for c in item.value)
        return super().format_completion(item)


def complete(group: click.Group, instruction: str) -> None:
    """Print what a shell asks for: the script (``bash_source``), or what completes the word (``bash_complete``)."""
    shell, _, what = instruction.partition("_")
    add_completion_class(EscapingBash)
    known = get_completion_class(shell)
    if known is not None and what in ("source", "complete"):
        asked = known(group, {}, "optimize-posture", VARIABLE)
        click.echo(asked.source() if what == "source" else asked.complete())


@click.command("completion")
@click.argument("shell", type=click.Choice(("bash", "fish", "zsh")))
@click.pass_context
def completion_command(ctx: click.Context, /, shell: str) -> None:
    """Print the completion script of a shell, which completes commands, options, tasks, presets, problems and files.

    \b
    bash:  optimize-posture completion bash > ~/.local/share/bash-completion/completions/optimize-posture
    zsh:   optimize-posture completion zsh > ~/.zfunc/_optimize-posture     (a folder of $fpath)
    fish:  optimize-posture completion fish > ~/.config/fish/completions/optimize-posture.fish

    It works in shells that are opened afterwards.
    """
    group = ctx.find_root().command
    assert isinstance(group, click.Group)
    complete(group, f"{shell}_source")
