"""The reference of the command line, read off its click commands."""

from __future__ import annotations

import inspect
import re

import click

from posture_opt.cli.main import COMMANDS, main


def command_line_page() -> str:
    """A section of options for the solve, then one for every command."""
    group = click.Context(main, info_name="optimize-posture")
    parts = [command_section("optimize-posture", main, group)]
    for name in sorted(COMMANDS):
        command = main.get_command(group, name)
        assert command is not None
        context = click.Context(command, info_name=name, parent=group)
        parts.append(command_section(f"optimize-posture {name}", command, context))
    return "\n".join(parts)


def command_section(path: str, command: click.Command, context: click.Context) -> str:
    """What a command does, how it is called, and its options as a table."""
    usage = " ".join(command.collect_usage_pieces(context))
    options = [p for p in command.params if isinstance(p, click.Option)]
    rows = [record for option in options if (record := option.get_help_record(context))]
    table = "\n".join(f"| {code(option)} | {words(text)} |" for option, text in rows)
    return f"""\
## {path.removeprefix("optimize-posture ")}

{prose(command.help or "")}

```text
{path} {usage}
```

| option | meaning |
| --- | --- |
{table}
"""


def code(option: str) -> str:
    """``--out DIR`` as code, its bars kept out of the table's way."""
    return f"`{cell(option.replace('INTEGER RANGE', 'N').replace('FLOAT RANGE', 'X'))}`"


def words(text: str) -> str:
    """A help text, the options that it names as code."""
    return re.sub(r"(?<![\w-])(--[a-z-]+)", r"`\1`", cell(text))


def cell(text: str) -> str:
    return text.replace("|", r"\|")


def prose(text: str) -> str:
    r"""The help text in Markdown: what follows \b keeps its line breaks."""
    blocks = re.split(r"\n\s*\n", inspect.cleandoc(text).strip())
    return "\n\n".join(
        "```text\n" + block.removeprefix("\b\n") + "\n```" if block.startswith("\b") else block for block in blocks
    )
