"""The best postures of many targets: random starts, exchange with neighbours, and again where they collide."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.numerics import Array, Progress
from posture_opt.selection.maps.map_exchange import NeighbourExchange, is_better, worked_on
from posture_opt.selection.maps.map_neighbours import Neighbourhood, Pairs
from posture_opt.selection.maps.map_points import MapCandidate, NeighbourSolves
from posture_opt.selection.maps.map_trials import BETTER, best_among, better_of, freedom, out_of_plane
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.workers import Workers
from posture_opt.workers.record_pattern import recorded

OUTLIER_EXCESS = 2e-3  # of the objective: a target so much above what its neighbours predict is an outlier
MAX_OUTLIER_SHARE = 0.03  # of the targets: how many of them are searched again


def outlying_targets(exchange: NeighbourExchange, searched: set[int]) -> list[int]:
    """Targets that are worse than their neighbours predict, the worst first, as many as are still worth a search.

    At most 3 % of the targets in all, half of what is left of them in each round.
    """
    excess = exchange.excess()
    left = math.ceil(MAX_OUTLIER_SHARE * len(excess)) - len(searched)
    odd = [int(k) for k in np.argsort(-excess, kind="stable") if excess[k] > OUTLIER_EXCESS and int(k) not in searched]
    return odd[: min(max(left, 0), math.ceil(left / 2))]


def targets_to_search_again(
    candidates: Sequence[MapCandidate], neighbourhood: Neighbourhood, share: float, seed: int
) -> list[int]:
    """A share of the targets, from which rare branches spread; and all that few random starts arrive at.

    These are where reach begins or ends, and where no start met the requirements. Where no start reached any target,
    all of them.
    """
    reached = np.array([candidate.status != "not reached" for candidate in candidates])
    if not reached.any():
        return list(range(len(candidates)))
    chosen = reached & (np.random.default_rng(seed).random(len(candidates)) < share)
    chosen |= np.array([candidate.status == "requirement not met" for candidate in candidates])
    for here, there in neighbourhood.on_grid:
        chosen[here[reached[here] != reached[there]]] = True
    return [int(k) for k in np.flatnonzero(chosen)]


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


SELF_COLLISION = "self-collision"
POSTURES_PER_CHUNK = 256  # postures that are looked at together


def clear_candidates(
    scene: Scene,
    guarded: Callable[[TaskTarget], Engine],
    targets: Sequence[TaskTarget],
    candidates: Sequence[MapCandidate],
    pairs: Sequence[Pairs],
    workers: Workers,
    *,
    seed: int,
    progress: Progress | None = None,
) -> list[MapCandidate]:
    """The candidates of the targets, those replaced that collide; the others are the best of all and stay.

    Args:
        guarded: the engine that keeps clear, for a target.
        pairs: targets that try each other's postures.
        workers: who works on the chunks; the answer does not depend on it.
        seed: of the random starts.
        progress: called with (done, total) of the targets that are solved again.
    """
    again = colliding(scene, candidates, workers)
    found = list(candidates)
    if not again:
        return found
    work = [targets[k] for k in again]
    points = np.array([target.lower for target in work])
    engines = [guarded(target) for target in work]
    arm = engines[0].optimisation_problem.arm
    neighbourhood = Neighbourhood.of(arm, work[0].direction, points, among(pairs, again))
    better, _ = best_candidates(engines, work, neighbourhood, workers, seed=seed, progress=progress)
    for k, candidate in zip(again, better, strict=True):
        found[k] = candidate
    return found


def colliding(scene: Scene, candidates: Sequence[MapCandidate], workers: Workers) -> list[int]:
    """Indices of the candidates with a posture that comes nearer to something than the margin of the scene.

    Distances are computed in chunks of 256 postures by the workers; none without an active scene.
    """
    held = [k for k, candidate in enumerate(candidates) if candidate.best is not None]
    if not held or not scene.active:
        return []
    chunks = [held[i : i + POSTURES_PER_CHUNK] for i in range(0, len(held), POSTURES_PER_CHUNK)]
    postures = [np.array([best.q for k in chunk if (best := candidates[k].best) is not None]) for chunk in chunks]
    clear = workers.in_order(_clear, scene, postures)
    return [
        k for chunk, flags in zip(chunks, clear, strict=True) for k, yes in zip(chunk, flags, strict=True) if not yes
    ]


@recorded(lambda scene, Q: (bool,) * len(Q))
def _clear(scene: Scene, Q: Array) -> list[bool]:
    """Of each posture of Q (N, n) whether it is clear."""
    return [bool(yes) for yes in is_clear(scene, Q)]


def in_the_way(scene: Scene, q: Array) -> str:
    """The obstacle that a colliding posture (n,) meets most; ``self-collision`` where it meets the arm itself."""
    k = int(np.argmin(scene.distances(q)[0] - np.array(scene.required)))
    return SELF_COLLISION if k < len(scene.own) else scene.pairs[k][1]


def among(pairs: Sequence[Pairs], chosen: Sequence[int]) -> list[Pairs]:
    """The pairs of targets that are both chosen, numbered by their places among the chosen ones.

    >>> [(a.tolist(), b.tolist()) for a, b in among([(np.array([0, 4]), np.array([4, 2]))], [4, 2])]
    [([0], [1])]
    """
    most = max((int(max(here.max(initial=0), there.max(initial=0))) for here, there in pairs), default=0)
    place = np.full(max(most, *chosen) + 1, -1)
    place[list(chosen)] = np.arange(len(chosen))
    kept = []
    for here, there in pairs:
        a, b = place[here], place[there]
        both = (a >= 0) & (b >= 0)
        if both.any():
            kept.append((a[both], b[both]))
    return kept
