"""What a shell may know of the command line: commands, options, and what may stand for their values."""

from __future__ import annotations

from dataclasses import dataclass

import click

from posture_opt.cli.completion import Named


@dataclass(frozen=True)
class Value:
    """What may stand at a place: ``names``, and ``files`` with one of the ``endings``, or folders alone."""

    names: tuple[str, ...] = ()
    endings: tuple[str, ...] = ()
    files: bool = False
    folders: bool = False


@dataclass(frozen=True)
class Option:
    """An option by all its names; ``value`` is None of a flag."""

    names: tuple[str, ...]
    help: str
    value: Value | None


@dataclass(frozen=True)
class CommandLine:
    """One command, ``name`` empty of the program itself; ``argument`` is what it takes without an option."""

    name: str
    help: str
    options: tuple[Option, ...]
    argument: Value


def value_of(parameter: click.Parameter) -> Value:
    """What may stand for a parameter."""
    kind, names = parameter.type, f"{parameter.metavar or ''}".lower()
    if isinstance(kind, Named):
        return Value(tuple(kind.names()), kind.endings, files=bool(kind.endings))
    if isinstance(kind, click.Choice):
        return Value(tuple(map(str, kind.choices)))
    if not isinstance(kind, click.Path):
        return Value()
    return Value((), (".csv",) if names.endswith(".csv") else (), files=names != "dir", folders=names == "dir")


def command_line(name: str, command: click.Command) -> CommandLine:
    """What a shell may know of a command."""
    options = [
        Option((*p.opts, *p.secondary_opts), p.help or "", None if p.is_flag or p.count else value_of(p))
        for p in command.params
        if isinstance(p, click.Option) and not p.hidden
    ]
    options.append(Option(("--help",), "Show the help.", None))
    arguments = [value_of(p) for p in command.params if isinstance(p, click.Argument)]
    return CommandLine(name, command.get_short_help_str(90), tuple(options), next(iter(arguments), Value()))


def every_command_line(ctx: click.Context) -> tuple[CommandLine, ...]:
    """The program itself, and all its commands."""
    group = ctx.find_root().command
    assert isinstance(group, click.Group)
    found = [(name, group.get_command(ctx, name)) for name in group.list_commands(ctx)]
    return (command_line("", group), *(command_line(name, command) for name, command in found if command is not None))
