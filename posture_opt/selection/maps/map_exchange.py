"""``NeighbourExchange``: targets of a map that take over postures from each other until none becomes better.

The best posture jumps from one branch to another somewhere between two neighbours. So wherever a neighbour's posture,
led here by inverse kinematics, is another one than that of the target, the solver decides between both: a branch that
random starts missed spreads over all targets where it is the best one.

The exchange goes in rounds: in each, every target sees what its neighbours had at the end of the round before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.maps.map_candidate import MapCandidate
from posture_opt.selection.maps.map_neighbours import Neighbourhood, Pairs
from posture_opt.selection.maps.map_rounds import CHUNK, worked_on
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
from posture_opt.workers import Workers

MIN_BENDS_SEEN = 60  # bends, from which on a posture falls short of its optimum by at most twice the largest of them
FIRST_TARGETS = 8 * CHUNK  # targets that are tried before that is asked for the first time
SAME_START = 0.1  # rad or m: a start so near to an optimum leads to it

Starts = dict[int, list[tuple[int, Array]]]
"""Target -> neighbours with their postures, joint 1 moved."""


@dataclass(frozen=True)
class NeighbourExchange:
    """Targets with the engines that solve them; ``candidates`` are the best ones known, replaced in place.

    Args:
        engines: N, one for each of ``targets``; many share one.
        neighbourhood: which targets try each other's postures, and how a posture is carried from one to another.
        workers: who works on the chunks; the answer does not depend on it.
        seed: of perturbed starts, together with round and target.
        candidates: N, the best known.
        tried: the postures of neighbours that the solver began with at each target.
        lost: those of them that ended at a worse optimum.
        bends: how far carried postures fell short of their optimum, over the squared distance: what others may
            promise.
    """

    engines: Sequence[Engine]
    targets: Sequence[TaskTarget]
    neighbourhood: Neighbourhood
    workers: Workers
    seed: int
    candidates: list[MapCandidate]
    tried: dict[int, list[Array]] = field(default_factory=dict)
    lost: dict[int, list[Array]] = field(default_factory=dict)
    bends: list[float] = field(default_factory=list)

    def spread(self, fresh: set[int]) -> None:
        """Exchange postures, those of ``fresh`` targets first, until no target becomes better."""
        rounds = 0
        while fresh:
            learnt = [self._learn(fresh, pairs) for pairs in (self.neighbourhood.on_grid, self.neighbourhood.turned)]
            fresh = set().union(*learnt) | self._try_around(fresh, rounds)
            rounds += 1

    def excess(self) -> Array:
        """By what share the objective of each target is above what its neighbours predict, (N,); −inf where nothing
        does.
        """
        best = [(c.best.objective * c.scale) if c.best is not None else math.nan for c in self.candidates]
        return self.neighbourhood.excess(np.array(best))

    def _learn(self, fresh: set[int], pairs: Sequence[Pairs]) -> set[int]:
        """Try the postures of ``fresh`` neighbours; the targets that became better."""
        starts = self._starts(fresh, pairs, others=True)
        # In a random order, so that what falls short is soon seen all over the map.
        order = np.random.default_rng(0).permutation(list(starts)).tolist()
        return self._try_all(order[:FIRST_TARGETS], starts) | self._try_all(order[FIRST_TARGETS:], starts)

    def _try_all(self, indices: Sequence[int], starts: Starts) -> set[int]:
        """Polish neighbours' postures at these targets; those that became better."""
        bend = min(BEND, 2 * max(self.bends)) if len(self.bends) >= MIN_BENDS_SEEN else BEND

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
        """Of equally good postures take the one of the neighbour: a map is read more easily, and an arm moves less.

        From the best candidate outwards, each target once (breadth first).
        """
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
        """At each first target the posture of the second one, where it is another one and as good."""
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
        """Of each target the neighbours that are ``fresh``, with their postures, joint 1 moved: those of its engine.

        Args:
            others: only postures that can lead to another one than that of the target.
            empty: only targets without a posture.
        """
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
        return ~(np.max(np.abs(Q - moved), axis=1, initial=0.0) < SAME_START)

    def _beside(self, k: int, starts: Sequence[tuple[int, Array]], **more: Any) -> NeighbourStarts:
        """What target k needs to try postures of its neighbours, with the squared distance of each over that of the
        reach.
        """
        reach = self.engines[k].optimisation_problem.reach.radius
        squares = [(self.neighbourhood.distance(j, k) / reach) ** 2 for j, _ in starts]
        return NeighbourStarts(self.targets[k], self.candidates[k], np.array([q for _, q in starts]), squares, **more)


def is_better(candidate: MapCandidate, known: MapCandidate) -> bool:
    """Whether a candidate is better than the known one, by more than nothing."""
    best, before = candidate.best, known.best
    return best is not None and (before is None or gain(best, before) > BETTER)
