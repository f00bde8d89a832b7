"""``NeighbourExchange``: targets of a map take over postures from each other, in rounds, until none becomes better.

The best posture jumps from one branch to another between two neighbours: a branch that random starts missed spreads.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np

from posture_opt.numerics import Array, Codes
from posture_opt.selection.maps.map_neighbours import Neighbourhood, Pairs
from posture_opt.selection.maps.map_points import MapCandidate
from posture_opt.selection.maps.map_trials import BEND, NeighbourStarts, Trial, take_over, try_all, try_around
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.workers import Part, Workers

CHUNK = 32
"""Targets of a part, about a tenth of a second; part of the answer, so that this does not depend on who works."""
T = TypeVar("T")
R = TypeVar("R")
Starts = dict[int, list[tuple[int, Array]]]
"""Target -> neighbours with their postures, joint 1 moved."""


@dataclass(frozen=True)
class Items(Sequence[Sequence[T]], Generic[T]):
    """Items of chunks of targets, made when they are sent: a map never holds all of them at once."""

    chunks: Sequence[Sequence[int]]
    item: Callable[[int], T]

    def __len__(self) -> int:
        return len(self.chunks)

    def __getitem__(self, k: Any) -> Any:
        return [self.item(target) for target in self.chunks[k]]


def worked_on(
    workers: Workers, part: Part[Engine, Sequence[T], Sequence[R]], engines: Sequence[Engine],
    indices: Iterable[int], item: Callable[[int], T],
) -> Iterator[tuple[int, R]]:  # fmt: skip
    """Targets with their rows of ``part(engine, [item, …])``, chunk by chunk of one engine, as they are done."""
    shares: dict[int, list[int]] = {}
    for k in indices:
        shares.setdefault(id(engines[k]), []).append(k)
    for mine in shares.values():
        chunks = [mine[i : i + CHUNK] for i in range(0, len(mine), CHUNK)]
        for k, rows in workers.run(part, engines[mine[0]], Items(chunks, item)):
            yield from zip(chunks[k], rows, strict=True)


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
        order, first = np.random.default_rng(0).permutation(list(starts)).tolist(), 8 * CHUNK
        return self._try_all(order[:first], starts) | self._try_all(order[first:], starts)

    def _try_all(self, indices: Sequence[int], starts: Starts) -> set[int]:
        # Twice the largest of 60 bounds what a posture falls short.
        bend = min(BEND, 2 * max(self.bends)) if len(self.bends) >= 60 else BEND

        def item(k: int) -> NeighbourStarts:
            return self._beside(k, starts[k], tried=self.tried.get(k, ()), bend=bend)

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

        def item(k: int) -> NeighbourStarts:
            return self._beside(k, starts[k], seed=(self.seed, rounds, k))

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
        starts: Starts = {}
        if pairs:
            self._add_moved(
                starts, self._postures(), np.array(list(pairs)), np.array(list(pairs.values())), others=True
            )

        def item(k: int) -> NeighbourStarts:
            return self._beside(k, starts[k], tried=self.lost.get(k, ()))

        for k, row in worked_on(self.workers, take_over, self.engines, list(starts), item):
            self.candidates[k] = MapCandidate.unpacked(row)

    def _postures(self) -> Array:
        """(N, n) best known [rad or m]; NaN without one."""
        nothing = np.full(self.engines[0].robot.n, np.nan)
        return np.array([nothing if one.best is None else one.best.q for one in self.candidates])

    def _starts(self, fresh: set[int], pairs: Sequence[Pairs], *, others: bool = False, empty: bool = False) -> Starts:
        """Neighbours among ``fresh`` and their postures; ``others`` that differ, ``empty`` targets alone."""
        new = np.array([k in fresh and one.best is not None for k, one in enumerate(self.candidates)])
        Q, engine = self._postures(), np.array([id(one) for one in self.engines])
        starts: Starts = {}
        for here, there in pairs:
            chosen = new[there] & (engine[here] == engine[there])
            if empty:
                chosen &= np.isnan(Q[here, 0])
            if chosen.any():
                self._add_moved(starts, Q, here[chosen], there[chosen], others=others)
        return starts

    def _add_moved(self, starts: Starts, Q: Array, here: Codes, there: Codes, *, others: bool) -> None:
        """Add postures Q[there], joint 1 moved; ``others``: only those 0.1 rad or m away, that may end elsewhere."""
        moved = self.neighbourhood.carried(Q[there], there, here)
        near = np.max(np.abs(Q[here] - moved), axis=1, initial=0.0) < 0.1 if others else np.zeros(len(here), dtype=bool)
        for k, j, q in zip(here[~near].tolist(), there[~near].tolist(), moved[~near], strict=True):
            starts.setdefault(k, []).append((j, q))

    def _beside(self, k: int, starts: Sequence[tuple[int, Array]], **more: Any) -> NeighbourStarts:
        reach = self.engines[k].optimisation_problem.reach.radius
        squares = [(self.neighbourhood.distance(j, k) / reach) ** 2 for j, _ in starts]
        return NeighbourStarts(self.targets[k], self.candidates[k], np.array([q for _, q in starts]), squares, **more)
