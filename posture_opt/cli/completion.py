"""``optimize-posture completion``: what a shell needs to complete commands, options and their values.

The scripts are click's own. They ask this program when the tab key is pressed, which must be fast: see ``deferred``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
from click.shell_completion import BashComplete, CompletionItem, add_completion_class, get_completion_class

from posture_opt.cli.asked.named_values import FILE

if TYPE_CHECKING:
    from typing import Any

PROGRAM = "optimize-posture"
VARIABLE = "_OPTIMIZE_POSTURE_COMPLETE"
"""Of the environment, by which the scripts ask for the words that may follow."""
_SHELLS = ("bash", "fish", "zsh")
_SPECIAL = frozenset(" \t!\"#$&'()*;<>?[\\]^`{|}")


class EscapingBash(BashComplete):
    """click's completion for bash, which knows the equals sign of ``--task=`` and spaces in names of files."""

    def get_completion_args(self) -> tuple[list[str], str]:
        """The words before the cursor and the one at it; bash makes the equals sign a word of its own."""
        args, incomplete = super().get_completion_args()
        return [word for word in args if word != "="], "" if incomplete == "=" else incomplete

    def format_completion(self, item: CompletionItem[Any]) -> str:
        """The item in a line; in the name of a file a backslash before what is special, and one before that."""
        if item.kind == FILE:
            item.value = "".join(f"\\\\{c}" if c in _SPECIAL else c for c in item.value)
        return super().format_completion(item)


def complete(group: click.Group, instruction: str) -> None:
    """Print what a shell asks for: the script (``bash_source``), or what completes the word (``bash_complete``)."""
    shell, _, what = instruction.partition("_")
    add_completion_class(EscapingBash)
    known = get_completion_class(shell)
    if known is not None and what in ("source", "complete"):
        asked = known(group, {}, PROGRAM, VARIABLE)
        click.echo(asked.source() if what == "source" else asked.complete())


@click.command("completion")
@click.argument("shell", type=click.Choice(_SHELLS))
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
