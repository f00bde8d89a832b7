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


def outlying_targets(exchange: NeighbourExchange, searched: set[int]) -> list[int]:
    """Targets above their neighbours' prediction, worst first: half of those left of 3 % of all."""
    excess = exchange.excess()
    left = math.ceil(0.03 * len(excess)) - len(searched)
    odd = [int(k) for k in np.argsort(-excess, kind="stable") if excess[k] > 2e-3 and int(k) not in searched]
    return odd[: min(max(left, 0), math.ceil(left / 2))]


def targets_to_search_again(
    candidates: Sequence[MapCandidate], neighbourhood: Neighbourhood, share: float, seed: int
) -> list[int]:
    """A share of all targets, those at the edge of the reach, and those that miss a requirement."""
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
SECOND_EFFORT: Effort = (144, 144, 144)  # of those at the edge of the reach, and of a share of the others
THIRD_EFFORT: Effort = (96, 288, 288)  # of outliers
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
    """Random starts, more at the edge of the reach, exchange with neighbours, outliers again, agreement."""
    candidates: list[MapCandidate] = [MapCandidate("not reached", None, math.nan)] * len(targets)

    def explored(indices: Iterable[int], effort: Effort) -> Iterator[tuple[int, MapCandidate]]:
        def item(chunk: Sequence[int]) -> Exploration:
            mine, known = [targets[k] for k in chunk], [candidates[k] for k in chunk]
            return Exploration(mine, chunk, known, effort, seed)

        for k, row in worked_on(workers, explore, engines, indices, item):
            yield k, MapCandidate.unpacked(row)

    first = FIRST_EFFORT if len(targets) <= 256 else FINE_EFFORT
    for done, (k, candidate) in enumerate(explored(range(len(targets)), first), start=1):
        candidates[k] = candidate
        if progress is not None:
            progress(done, len(targets))
    share = 0.05 if freedom(engines[0], targets[0]) > 0 else 0.0
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
    """What is to be explored."""

    targets: Sequence[TaskTarget]  # with one engine
    indices: Sequence[int]  # seed them, each target by its own
    known: Sequence[MapCandidate]  # what was found for them before
    effort: Effort
    seed: int


@recorded(lambda engine, item: (MapCandidate.pattern(engine.optimisation_problem.robot.n),) * len(item.targets))
def explore(engine: Engine, item: Exploration) -> list[list[Any]]:
    """Packed candidates by random starts, each seeded by its own index, whatever its chunk."""
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
    """Candidates, colliding ones solved again with rows that keep clear."""
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
    """Candidates that come nearer to something than the scene's margin."""
    held = [k for k, candidate in enumerate(candidates) if candidate.best is not None]
    if not held or not scene.active:
        return []
    chunks = [held[i : i + 256] for i in range(0, len(held), 256)]
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
    """Pairs of targets that are both chosen, renumbered by their places among the chosen."""
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
