"""The options that say who does the work: ``--workers`` here, or the workers of a ``--scheduler``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import click

from posture_opt.cli.options import Command, Common, add_options
from posture_opt.workers import Workers, opened
from posture_opt.workers.dask_cluster import scheduled


def scheduler_option(command: Command) -> Command:
    """Adds the option that names a scheduler."""
    help_text = "Share the work by Dask: 'local' for --workers processes here, or tcp://HOST:PORT."
    return add_options(command, click.option("--scheduler", metavar="local|tcp://HOST:PORT", help=help_text))


@contextmanager
def working(common: Common, scheduler: str | None) -> Iterator[Workers]:
    """The workers that the options name, which end with the block."""
    with opened(common.workers) if scheduler is None else scheduled(scheduler, common.workers) as workers:
        yield workers
