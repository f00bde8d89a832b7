"""The options that say who does the work, and the file in which finished parts are kept."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from posture_opt.cli.completion import PATH
from posture_opt.cli.options import Command, Common, add_options
from posture_opt.errors import InputError
from posture_opt.files import located, naming
from posture_opt.files import opened as opened_file
from posture_opt.limits import MAX_TABLE_BYTES
from posture_opt.workers import Workers, opened
from posture_opt.workers.checkpoint import Checkpoint
from posture_opt.workers.dask_cluster import scheduled

if TYPE_CHECKING:
    from posture_opt.numerics import Json
    from posture_opt.problem.problem import Problem

_BLOCK_BYTES = 1 << 20  # Bytes of a file that are read at a time


def scheduler_option(command: Command) -> Command:
    """Adds the option that names a scheduler."""
    help_text = "Share the work by Dask: 'local' for --workers processes here, or tcp://HOST:PORT."
    return add_options(command, click.option("--scheduler", metavar="local|tcp://HOST:PORT", help=help_text))


def checkpoint_option(command: Command) -> Command:
    """Adds the option that names a file for what is done."""
    help_text = "Save finished work here; the same command continues an interrupted run."
    kind = PATH
    return add_options(command, click.option("--checkpoint", type=kind, metavar="FILE", help=help_text))


@contextmanager
def working(common: Common, scheduler: str | None, checkpoint: Path | None = None, **asked: Json) -> Iterator[Workers]:
    """The workers that the options name, which end with the block."""
    with opened(common.workers) if scheduler is None else scheduled(scheduler, common.workers) as workers:
        if checkpoint is None:
            yield workers
        else:
            with Checkpoint(located(Path(), str(checkpoint)), asked, workers) as kept:
                yield kept


def digest_of(problem: Problem) -> str:
    """Hash of all that a problem says, also in the files that it names; 16 hexadecimal digits of SHA-256."""
    whole = {"file": problem.to_yaml(), "robot": asdict(problem.robot), "covariance": problem.sources.covariance}
    return hashlib.sha256(json.dumps(whole, default=_plain).encode()).hexdigest()[:16]


def digest_of_file(path: Path | None) -> str | None:
    """Name of a file and hash of its content; None without a file."""
    if path is None:
        return None
    try:
        with opened_file(path, MAX_TABLE_BYTES) as stream:
            found = hashlib.sha256()
            for block in iter(lambda: stream.read(_BLOCK_BYTES), b""):
                found.update(block)
    except InputError as error:
        raise naming(path, error) from None
    return f"{path} ({found.hexdigest()[:16]})"


def _plain(value: object) -> Json:
    tolist: Callable[[], Json] | None = getattr(value, "tolist", None)  # NumPy is not loaded for one name
    return str(value) if tolist is None else tolist()
