"""The best postures of many targets at once: random starts for all of them in batches, then what neighbours know.

Targets next to each other mostly have the same best branch of the inverse kinematics, and targets that joint 1 turns
onto each other have the same branches. So each target tries the postures of both: a better posture spreads over the
map, a missing one is found next to a known one, and of equally good ones all targets take the same. Targets that are
still worse than their neighbours predict are searched again with many more starts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.numerics import Progress
from posture_opt.selection.maps.map_candidate import MapCandidate
from posture_opt.selection.maps.map_exchange import NeighbourExchange, is_better
from posture_opt.selection.maps.map_neighbours import Neighbourhood
from posture_opt.selection.maps.map_points import NeighbourSolves
from posture_opt.selection.maps.map_rounds import worked_on
from posture_opt.selection.maps.map_solved_again import outlying_targets, targets_to_search_again
from posture_opt.selection.maps.map_starts import best_among, better_of, freedom, out_of_plane
from posture_opt.selection.maps.map_trials import BETTER
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.workers import Workers
from posture_opt.workers.record_pattern import recorded

FIRST_EFFORT: Effort = (48, 48, 48)  # of every target of a small map
FINE_EFFORT: Effort = (24, 24, 24)
# Of every target of a larger one, where neighbours know more of each other: of seven arms
# at 26 x 26 targets 3 of 4732 fell short of the best known by 0.5 % with either; at 10 x 9, one of a Panda's 90 more
SMALL_MAP_TARGETS = 256  # targets: up to here a map is small
SECOND_EFFORT: Effort = (144, 144, 144)  # of those at the edge of the reach, and of a share of the others
THIRD_EFFORT: Effort = (96, 288, 288)  # of outliers
SEARCHED_AGAIN_SHARE = 0.05  # of the targets, where any way is left free
Effort = tuple[int, int, int]
"""Random starts of a target where 0, 1, or more ways are left free."""


def best_candidates(
    engines: Sequence[Engine],
    targets: Sequence[TaskTarget],
    neighbourhood: Neighbourhood,
    workers: Workers,
    *,
    seed: int,
    progress: Progress | None = None,
) -> tuple[list[MapCandidate], NeighbourSolves]:
    """The best candidate of every target (N of them, points), each with the engine that solves it.

    Steps: random starts for all targets; more starts at the edge of the reach and for a share of the others; exchange
    of postures between neighbours; many starts for outliers, and exchange again; agreement on equal postures.

    Args:
        engines: N, one for each target; many share one.
        neighbourhood: which targets try each other's postures.
        workers: who works on the chunks; the answer does not depend on it.
        seed: of the random starts.
        progress: called with (done, total) targets of the first search, which is the larger part.
    """
    candidates: list[MapCandidate] = [MapCandidate("not reached", None, math.nan)] * len(targets)

    def explored(indices: Iterable[int], effort: Effort) -> Iterator[tuple[int, MapCandidate]]:
        def item(chunk: Sequence[int]) -> Exploration:
            mine, known = [targets[k] for k in chunk], [candidates[k] for k in chunk]
            return Exploration(mine, chunk, known, effort, seed)

        for k, row in worked_on(workers, explore, engines, indices, item):
            yield k, MapCandidate.unpacked(row)

    first = FIRST_EFFORT if len(targets) <= SMALL_MAP_TARGETS else FINE_EFFORT
    for done, (k, candidate) in enumerate(explored(range(len(targets)), first), start=1):
        candidates[k] = candidate
        if progress is not None:
            progress(done, len(targets))
    share = SEARCHED_AGAIN_SHARE if freedom(engines[0], targets[0]) > 0 else 0.0
    for k, candidate in explored(targets_to_search_again(candidates, neighbourhood, share, seed), SECOND_EFFORT):
        candidates[k] = candidate
    alone = [candidate.best for candidate in candidates]
    exchange = NeighbourExchange(engines, targets, neighbourhood, workers, seed, candidates)
    exchange.spread({k for k, best in enumerate(alone) if best is not None})
    searched: set[int] = set()
    while odd := outlying_targets(exchange, searched):
        searched |= set(odd)
        better = set()
        for k, candidate in explored(odd, THIRD_EFFORT):
            better |= {k} if is_better(candidate, candidates[k]) else set()
            candidates[k] = candidate
        exchange.spread(better)
    solves = _statistics(alone, exchange, searched)
    exchange.agree()
    return candidates, solves


def _statistics(
    alone: Sequence[CandidatePosture | None], exchange: NeighbourExchange, searched: set[int]
) -> NeighbourSolves:
    """What the exchange brought: ``1 − σ_new / σ_old`` of targets solved again, and how many were found."""
    now = [candidate.best for candidate in exchange.candidates]
    gains = [1 - new.sigma / old.sigma for old, new in zip(alone, now, strict=True) if old and new and old.sigma > 0]
    better = [gain for gain in gains if gain > BETTER]
    again = {k for k in exchange.tried if alone[k] is not None} | searched
    found = sum(new is not None for new in now) - sum(old is not None for old in alone)
    return NeighbourSolves(len(again), len(better), max(better, default=0.0), found)


@dataclass(frozen=True)
class Exploration:
    """What is to be explored.

    Args:
        targets: with one engine.
        indices: seed them, each target by its own.
        known: what was found for them before.
    """

    targets: Sequence[TaskTarget]
    indices: Sequence[int]
    known: Sequence[MapCandidate]
    effort: Effort
    seed: int


@recorded(lambda engine, item: (MapCandidate.pattern(engine.optimisation_problem.robot.n),) * len(item.targets))
def explore(engine: Engine, item: Exploration) -> list[list[Any]]:
    """The packed candidate of every target, by random starts, or the known one where that is better.

    The starts of a target depend on the seed, their number and its index alone, not on the chunk that it is in.
    """
    targets, candidates = item.targets, list(item.known)
    open_ = [k for k in range(len(targets)) if not out_of_plane(engine, targets[k])]
    if open_:
        starts = item.effort[min(max(freedom(engine, targets[0]), 0), 2)]
        rngs = [np.random.default_rng([item.seed, starts, item.indices[k]]) for k in open_]
        Q = [engine.ik.random_postures(starts, rng) for rng in rngs]
        requests = [engine.request(targets[k], starts, rng) for k, rng in zip(open_, rngs, strict=True)]
        for k, reached in zip(open_, engine.ik.reached(Q, requests), strict=True):
            if len(reached):
                found = best_among(engine, targets[k], reached)
                candidates[k] = better_of(engine, targets[k], candidates[k], found)
    return [candidate.packed() for candidate in candidates]
