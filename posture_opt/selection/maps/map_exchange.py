"""``NeighbourExchange``: targets of a map take over postures from each other, in rounds, until none becomes better."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar, overload

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.maps.map_neighbours import Neighbourhood, Pairs
from posture_opt.selection.maps.map_points import MapCandidate
from posture_opt.selection.maps.map_trials import (
    BEND,
    BETTER,
    NeighbourStarts,
    Trial,
    gain,
    take_over,
    try_all,
    try_around,
)
from posture_opt.selection.program.task_target import TaskTarget
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
    """Targets with their rows of ``part(engine, item)``, chunk by chunk, as they are done."""
    for engine, mine in by_engine(engines, indices):
        chunks = chunks_of(mine)
        for k, rows in workers.run(part, engine, Items(chunks, item)):
            yield from zip(chunks[k], rows, strict=True)


FIRST_TARGETS = 8 * CHUNK  # targets that are tried before that is asked for the first time

Starts = dict[int, list[tuple[int, Array]]]
"""Target -> neighbours with their postures, joint 1 moved."""


@dataclass(frozen=True)
class NeighbourExchange:
    """Targets with the engines that solve them; ``candidates`` are the best ones known, replaced in place."""

    engines: Sequence[Engine]  # N, one for each of targets; many share one
    targets: Sequence[TaskTarget]
    # which targets try each other's postures, and how a posture is carried from one to another
    neighbourhood: Neighbourhood
    workers: Workers  # who works on the chunks; the answer does not depend on it
    seed: int  # of perturbed starts, together with round and target
    candidates: list[MapCandidate]  # N, the best known
    # the postures of neighbours that the solver began with at each target
    tried: dict[int, list[Array]] = field(default_factory=dict)
    lost: dict[int, list[Array]] = field(default_factory=dict)  # those of them that ended at a worse optimum
    # how far carried postures fell short of their optimum, over the squared distance: what others may promise
    bends: list[float] = field(default_factory=list)

    def spread(self, fresh: set[int]) -> None:
        """Exchange postures, those of ``fresh`` targets first, until no target becomes better."""
        rounds = 0
        while fresh:
            learnt = [self._learn(fresh, pairs) for pairs in (self.neighbourhood.on_grid, self.neighbourhood.turned)]
            fresh = set().union(*learnt) | self._try_around(fresh, rounds)
            rounds += 1

    def excess(self) -> Array:
        """(N,) share of each objective above the neighbours' prediction; −inf without one."""
        best = [(c.best.objective * c.scale) if c.best is not None else math.nan for c in self.candidates]
        return self.neighbourhood.excess(np.array(best))

    def _learn(self, fresh: set[int], pairs: Sequence[Pairs]) -> set[int]:
        """Try the postures of ``fresh`` neighbours; the targets that became better."""
        starts = self._starts(fresh, pairs, others=True)
        # In a random order, so that what falls short is soon seen all over the map.
        order = np.random.default_rng(0).permutation(list(starts)).tolist()
        return self._try_all(order[:FIRST_TARGETS], starts) | self._try_all(order[FIRST_TARGETS:], starts)

    def _try_all(self, indices: Sequence[int], starts: Starts) -> set[int]:
        # from so many on, twice the largest bounds what a posture falls short
        bend = min(BEND, 2 * max(self.bends)) if len(self.bends) >= 60 else BEND

        def item(chunk: Sequence[int]) -> list[NeighbourStarts]:
            return [self._beside(k, starts[k], tried=self.tried.get(k, ()), bend=bend) for k in chunk]

        better = set()
        for k, row in worked_on(self.workers, try_all, self.engines, indices, item):
            trial = Trial.unpacked(row)
            self.candidates[k] = trial.candidate
            if trial.tried:
                self.tried[k] = trial.tried
            if trial.lost:
                self.lost.setdefault(k, []).extend(trial.lost)
            self.bends.extend(trial.bends)
            better |= {k} if trial.better else set()
        return better

    def _try_around(self, fresh: set[int], rounds: int) -> set[int]:
        """Look for postures of targets without one about those of ``fresh`` neighbours; those that have one now."""
        starts = self._starts(fresh, self.neighbourhood.pairs, empty=True)

        def item(chunk: Sequence[int]) -> list[NeighbourStarts]:
            return [self._beside(k, starts[k], seed=(self.seed, rounds, k)) for k in chunk]

        found = set()
        for k, row in worked_on(self.workers, try_around, self.engines, list(starts), item):
            self.candidates[k] = MapCandidate.unpacked(row)
            found |= {k} if self.candidates[k].best is not None else set()
        return found

    def agree(self) -> None:
        """Take neighbours' postures that are as good, from the best target outwards, breadth first."""
        known = {k: candidate.best for k, candidate in enumerate(self.candidates) if candidate.best is not None}
        followers: dict[int, list[int]] = {}
        for here, there in self.neighbourhood.on_grid:
            for k, j in zip(here.tolist(), there.tolist(), strict=True):
                if k in known and j in known and self.engines[j] is self.engines[k]:
                    followers.setdefault(j, []).append(k)
        while known:
            front = [min(known, key=lambda k: known[k].sigma)]
            while front:
                for k in front:
                    known.pop(k, None)
                pairs = {k: j for j in front for k in followers.get(j, []) if k in known}
                self._take_over(pairs)
                front = list(pairs)

    def _take_over(self, pairs: dict[int, int]) -> None:
        if not pairs:
            return
        here, there = np.array(list(pairs)), np.array(list(pairs.values()))
        own, other = (np.array([self._posture(k) for k in side]) for side in (here.tolist(), there.tolist()))
        moved = self.neighbourhood.carried(other, there, here)
        apart = self._apart(own, moved)
        starts = {int(k): [(int(j), q)] for k, j, q in zip(here[apart], there[apart], moved[apart], strict=True)}

        def item(chunk: Sequence[int]) -> list[NeighbourStarts]:
            return [self._beside(k, starts[k], tried=self.lost.get(k, ())) for k in chunk]

        for k, row in worked_on(self.workers, take_over, self.engines, list(starts), item):
            self.candidates[k] = MapCandidate.unpacked(row)

    def _starts(self, fresh: set[int], pairs: Sequence[Pairs], *, others: bool = False, empty: bool = False) -> Starts:
        """Neighbours among ``fresh`` and their postures, joint 1 moved, by target."""
        best = [candidate.best for candidate in self.candidates]
        new = np.array([k in fresh and one is not None for k, one in enumerate(best)])
        nothing = np.full(self.engines[0].robot.n, np.nan)
        Q = np.array([nothing if one is None else one.q for one in best])
        engine = np.array([id(one) for one in self.engines])
        starts: Starts = {}
        for here, there in pairs:
            chosen = new[there] & (engine[here] == engine[there])
            if empty:
                chosen &= np.isnan(Q[here, 0])
            k, j = here[chosen], there[chosen]
            moved = self.neighbourhood.carried(Q[j], j, k) if len(k) else Q[:0]
            kept = self._apart(Q[k], moved) if others else np.ones(len(k), dtype=bool)
            for one, other, q in zip(k[kept].tolist(), j[kept].tolist(), moved[kept], strict=True):
                starts.setdefault(one, []).append((other, q))
        return starts

    def _posture(self, k: int) -> Array:
        """(n,) the posture of a target that has one."""
        best = self.candidates[k].best
        assert best is not None
        return best.q

    @staticmethod
    def _apart(Q: Array, moved: Array) -> Any:
        """(M,) whether a posture can lead to anything but the one that its target has, if any."""
        # rad or m: a start so near to an optimum leads to it
        return ~(np.max(np.abs(Q - moved), axis=1, initial=0.0) < 0.1)

    def _beside(self, k: int, starts: Sequence[tuple[int, Array]], **more: Any) -> NeighbourStarts:
        reach = self.engines[k].optimisation_problem.reach.radius
        squares = [(self.neighbourhood.distance(j, k) / reach) ** 2 for j, _ in starts]
        return NeighbourStarts(self.targets[k], self.candidates[k], np.array([q for _, q in starts]), squares, **more)


def is_better(candidate: MapCandidate, known: MapCandidate) -> bool:
    """Whether a candidate is better than the known one, by more than nothing."""
    best, before = candidate.best, known.best
    return best is not None and (before is None or gain(best, before) > BETTER)
