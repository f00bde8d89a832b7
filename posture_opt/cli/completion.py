"""``optimize-posture completion``: a script that lets a shell complete commands, options and their values.

The script holds all names, so that a shell asks no program when the tab key is pressed. It is made anew after an
update.
"""

from __future__ import annotations

import click

from posture_opt.cli.command_line import every_command_line
from posture_opt.cli.completion_scripts import SCRIPTS


@click.command("completion")
@click.argument("shell", type=click.Choice(sorted(SCRIPTS)))
@click.pass_context
def completion_command(ctx: click.Context, /, shell: str) -> None:
    """Print the completion script of a shell, which completes commands, options, tasks, presets, problems and files.

    \b
    bash:  optimize-posture completion bash > ~/.local/share/bash-completion/completions/optimize-posture
    zsh:   optimize-posture completion zsh > ~/.zfunc/_optimize-posture     (a folder of $fpath)
    fish:  optimize-posture completion fish > ~/.config/fish/completions/optimize-posture.fish

    It works in shells that are opened afterwards. Print it again after an update.
    """
    click.echo(SCRIPTS[shell](every_command_line(ctx)).rstrip("\n"))
