"""Where the parts of a computation are worked on: here, in other processes, in any executor, on a Dask cluster."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self, TypeAlias, TypeVar, cast, runtime_checkable

from posture_opt.errors import InputError, Issue

if TYPE_CHECKING:
    from concurrent.futures import Executor as FuturesExecutor

__all__ = ["Executor", "Part", "Serial", "Workers", "opened"]


S = TypeVar("S")  # What all parts of a round share
T = TypeVar("T")  # What is worked on, one an item
R = TypeVar("R")  # What comes of an item
# ``(shared, item) -> result``, a function of a module: other processes import it by its name.
Part = Callable[[S, T], R]

# Parts that other machines have at once: enough for any cluster, and memory does not grow with the work.
MAX_SUBMITTED_PARTS = 64
_PART_LOCK = threading.RLock()  # Held while a part is computed; a part may have parts of its own


class Workers(ABC):
    """Works on the parts of a round, each a pure function of what all parts share and of its own item."""

    @abstractmethod
    def run(self, part: Part[S, T, R], shared: S, items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """The number of each item with ``part(shared, item)``, in the order in which they are done."""

    def in_order(self, part: Part[S, T, R], shared: S, items: Sequence[T]) -> list[R]:
        """The results of all items, in their order; it waits for the last one."""
        done = dict(self.run(part, shared, items))
        return [done[k] for k in range(len(items))]

    def close(self) -> None:  # noqa: B027 # most have nothing to close
        """End what was started for this: processes and connections of its own."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def worked(part: Part[S, T, R], shared: S, item: T) -> R:
    """``part(shared, item)``, and no other part at the same time in this process: solvers are not made for threads."""
    with _PART_LOCK:
        return part(shared, item)


class Serial(Workers):
    """Works on one part after the other, in this process."""

    def run(self, part: Part[S, T, R], shared: S, items: Sequence[T]) -> Iterator[tuple[int, R]]:
        """As of `Workers`, in the order of the items."""
        for k, item in enumerate(items):
            yield k, worked(part, shared, item)


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
        return _workers_of("executors", "ExecutorWorkers", executor)
    if isinstance(executor, DaskClient):
        return _workers_of("dask_cluster", "DaskWorkers", executor)
    hint = "give one of concurrent.futures, or a dask.distributed Client"
    raise InputError(Issue(f"{type(executor).__name__} is no executor", ("executor",), hint=hint))


def _workers_of(file: str, name: str, argument: object) -> Workers:
    return cast(Workers, getattr(import_module(f"posture_opt.workers.{file}"), name)(argument))
