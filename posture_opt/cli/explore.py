"""``optimize-posture explore``: a live page on which the best posture follows the target."""

from __future__ import annotations

import webbrowser
from importlib import import_module
from pathlib import Path

import click

import posture_opt as po
from posture_opt.cli import deferred
from posture_opt.cli.asked.named_values import PATH
from posture_opt.cli.asked.options import problem_options, task_options


@click.command("explore")
@click.argument("data", type=PATH, metavar="[DATA.csv]", required=False)
@problem_options
@task_options
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address of this machine; 0.0.0.0: all of them, with a token.",
)
@click.option(
    "--port", type=click.IntRange(1, 65535), default=8080, show_default=True, help="Port, or the next one that is free."
)
@click.option("--no-browser", is_flag=True, help="Open no browser.")
@click.option("--debug", is_flag=True, hidden=True)
def explore_command(
    data: Path | None, host: str, port: int, no_browser: bool, debug: bool, **given: str | None
) -> None:
    """Drag the target on a live page, and the best posture follows. Ctrl-C ends it.

    DATA.csv has measurements, whose errors the page shows; --problem can be the folder of a diagnosis or calibration.
    """
    problem = deferred.requested_problem(**given)
    with deferred.placed(problem):
        measured = None if data is None else po.read_measurements(data, problem)
        page = import_module("posture_opt.explore.explorer").Explorer(problem, host, port, data=measured)
    with page:
        click.echo(f"Listening on {page.url}")
        if page.reach:
            click.echo(page.reach, err=True)
        if not no_browser:
            webbrowser.open_new_tab(page.url)
        page.wait()
