"""Rounds of a map search: the targets of each engine in chunks, each of them a part for one worker.

A part is a pure function of its engine and its chunk; so the same map comes from one worker or many, here or
elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar, overload

from posture_opt.selection.search.engine import Engine
from posture_opt.workers import Part, Workers

CHUNK = 32
"""Targets of a part: about a tenth of a second. The answer knows it, so that it does not depend on who works."""

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Items(Sequence[T], Generic[T]):
    """What is sent with each chunk, put together when it is sent, so that a map never holds all of it at once."""

    chunks: Sequence[Sequence[int]]
    item: Callable[[Sequence[int]], T]

    def __len__(self) -> int:
        return len(self.chunks)

    @overload
    def __getitem__(self, k: int) -> T: ...
    @overload
    def __getitem__(self, k: slice) -> Sequence[T]: ...
    def __getitem__(self, k: int | slice) -> T | Sequence[T]:
        if isinstance(k, slice):
            return Items(self.chunks[k], self.item)
        return self.item(self.chunks[k])


def by_engine(engines: Sequence[Engine], indices: Iterable[int]) -> list[tuple[Engine, list[int]]]:
    """Each engine with the indices of those targets that it serves, in the order of the first of them."""
    shares: dict[int, list[int]] = {}
    for k in indices:
        shares.setdefault(id(engines[k]), []).append(k)
    return [(engines[mine[0]], mine) for mine in shares.values()]


def chunks_of(indices: Sequence[int]) -> list[Sequence[int]]:
    """Indices of targets, `CHUNK` at a time."""
    return [indices[i : i + CHUNK] for i in range(0, len(indices), CHUNK)]


def worked_on(
    workers: Workers,
    part: Part[Engine, T, Sequence[R]],
    engines: Sequence[Engine],
    indices: Iterable[int],
    item: Callable[[Sequence[int]], T],
) -> Iterator[tuple[int, R]]:
    """Each of some targets with its row of what the part returns for its chunk, as they are done.

    Args:
        part: ``part(engine, item)`` returns a row for each target of the chunk.
        item: what is sent with a chunk of targets, all of one engine.
    """
    for engine, mine in by_engine(engines, indices):
        chunks = chunks_of(mine)
        for k, rows in workers.run(part, engine, Items(chunks, item)):
            yield from zip(chunks[k], rows, strict=True)
