"""Where the parts of a computation are worked on: here, in other processes, in any executor, on a Dask cluster."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Protocol, TypeAlias, cast, runtime_checkable

from posture_opt.errors import InputError, Issue
from posture_opt.workers.workers import Part, Serial, Workers

if TYPE_CHECKING:
    from concurrent.futures import Executor as FuturesExecutor

__all__ = ["Executor", "Part", "Serial", "Workers", "opened"]


@runtime_checkable
class DaskClient(Protocol):
    """A ``distributed.Client``, by a method that executors of `concurrent.futures` lack."""

    def get_executor(self, **options: object) -> FuturesExecutor: ...


# What can be given as ``executor``: one of `concurrent.futures`, a ``distributed.Client``, or workers of this room.
Executor: TypeAlias = "FuturesExecutor | DaskClient | Workers"


def opened(workers: int = 1, executor: Executor | None = None) -> Workers:
    """The workers that a call means, to be used in a ``with`` block."""
    # What a solve in one process can do without is imported when it is asked for.
    if executor is None:
        return Serial() if workers == 1 else _workers_of("processes", "ProcessWorkers", workers)
    if isinstance(executor, Workers):
        return executor
    if isinstance(executor, import_module("concurrent.futures").Executor):
        return _workers_of("processes", "ExecutorWorkers", executor)
    if isinstance(executor, DaskClient):
        return _workers_of("dask_cluster", "DaskWorkers", executor)
    hint = "give one of concurrent.futures, or a dask.distributed Client"
    raise InputError(Issue(f"{type(executor).__name__} is no executor", ("executor",), hint=hint))


def _workers_of(file: str, name: str, argument: object) -> Workers:
    return cast(Workers, getattr(import_module(f"posture_opt.workers.{file}"), name)(argument))
