"""Which workers a call means: a number of processes, an executor, or a Dask client."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Protocol, TypeAlias, cast, runtime_checkable

from posture_opt.errors import InputError, Issue
from posture_opt.workers.serial import Serial
from posture_opt.workers.workers import Workers

if TYPE_CHECKING:
    from concurrent.futures import Executor as FuturesExecutor


@runtime_checkable
class DaskClient(Protocol):
    """The methods of a ``distributed.Client`` that are used here."""

    def submit(self, function: Callable[..., object], *arguments: object, **options: object) -> object:
        """A future of what the function gives on a worker."""

    def cancel(self, futures: Sequence[object]) -> object:
        """Cancels futures whose results are not needed any more."""

    def get_executor(self, **options: object) -> FuturesExecutor:
        """Not used: executors of `concurrent.futures` lack it, which distinguishes the two."""


Executor: TypeAlias = "FuturesExecutor | DaskClient | Workers"
"""What can be given as ``executor``: one of `concurrent.futures`, a ``distributed.Client``, or workers of this room."""


def opened(workers: int = 1, executor: Executor | None = None) -> Workers:
    """The workers that a call means, to be used in a ``with`` block.

    Args:
        workers: processes of this machine; one means this process.
        executor: who works instead; it stays open.

    Raises:
        InputError: an executor that is none.

    Example:
        >>> type(opened(1)).__name__
        'Serial'
    """
    # What a solve in one process can do without is imported when it is asked for.
    if executor is None:
        return Serial() if workers == 1 else _workers_of("processes", "ProcessWorkers", workers)
    if isinstance(executor, Workers):
        return executor
    if isinstance(executor, import_module("concurrent.futures").Executor):
        return _workers_of("executors", "ExecutorWorkers", executor)
    if isinstance(executor, DaskClient):
        return _workers_of("dask_cluster", "DaskWorkers", executor)
    hint = "give one of concurrent.futures, or a dask.distributed Client"
    raise InputError(Issue(f"{type(executor).__name__} is no executor", ("executor",), hint=hint))


def _workers_of(file: str, name: str, argument: object) -> Workers:
    """Workers of a class whose file is imported only now."""
    return cast(Workers, getattr(import_module(f"posture_opt.workers.{file}"), name)(argument))
