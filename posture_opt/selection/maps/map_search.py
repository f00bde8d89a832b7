"""The best postures of many targets: random starts, exchange with neighbours, and again where they collide."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.numerics import Array, Progress
from posture_opt.selection.maps.map_exchange import NeighbourExchange, Neighbourhood, Pairs, worked_on
from posture_opt.selection.maps.map_points import MapCandidate, NeighbourSolves, PackedRow
from posture_opt.selection.maps.map_trials import (
    BETTER,
    best_among,
    better_of,
    candidate_patterns,
    freedom,
    is_better,
    out_of_plane,
)
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.workers import Workers
from posture_opt.workers.record_pattern import recorded

Effort = tuple[int, int, int]
"""Random starts of a target where 0, 1, or more ways are left free."""
# Of seven arms at 26 x 26 targets 3 of 4732 fell short of the best known by 0.5 % with 48 or 24 starts; at 10 x 9, one
# of a Panda's 90 more with 24.
SMALL_MAP: Effort = (48, 48, 48)
LARGE_MAP: Effort = (24, 24, 24)
EDGE_OF_REACH: Effort = (144, 144, 144)  # and a share of the others
OUTLIERS: Effort = (96, 288, 288)
SELF_COLLISION = "self-collision"


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
        def item(k: int) -> Exploration:
            return Exploration(targets[k], k, candidates[k], effort, seed)

        for k, row in worked_on(workers, explore, engines, indices, item):
            yield k, MapCandidate.unpacked(row)

    first = SMALL_MAP if len(targets) <= 256 else LARGE_MAP
    for done, (k, candidate) in enumerate(explored(range(len(targets)), first), start=1):
        candidates[k] = candidate
        if progress is not None:
            progress(done, len(targets))
    share = 0.05 if freedom(engines[0], targets[0]) > 0 else 0.0
    for k, candidate in explored(targets_to_search_again(candidates, neighbourhood, share, seed), EDGE_OF_REACH):
        candidates[k] = candidate
    alone = [candidate.best for candidate in candidates]
    exchange = NeighbourExchange(engines, targets, neighbourhood, workers, seed, candidates)
    exchange.spread({k for k, best in enumerate(alone) if best is not None})
    searched: set[int] = set()
    while odd := outlying_targets(exchange, searched):
        searched |= set(odd)
        better = set()
        for k, candidate in explored(odd, OUTLIERS):
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
    """A target to be explored; its index seeds it."""

    target: TaskTarget
    index: int
    known: MapCandidate
    effort: Effort
    seed: int


@recorded(candidate_patterns)
def explore(engine: Engine, items: Sequence[Exploration]) -> list[PackedRow]:
    """Packed candidates by random starts, each seeded by its own index, whatever its chunk."""
    candidates = [item.known for item in items]
    open_ = [k for k, item in enumerate(items) if not out_of_plane(engine, item.target)]
    if open_:
        starts = items[0].effort[min(max(freedom(engine, items[0].target), 0), 2)]
        rngs = [np.random.default_rng([items[k].seed, starts, items[k].index]) for k in open_]
        Q = [engine.ik.random_postures(starts, rng) for rng in rngs]
        requests = [engine.request(items[k].target, starts, rng) for k, rng in zip(open_, rngs, strict=True)]
        for k, reached in zip(open_, engine.ik.reached(Q, requests), strict=True):
            if len(reached):
                target = items[k].target
                candidates[k] = better_of(engine, target, candidates[k], best_among(engine, target, reached))
    return [candidate.packed() for candidate in candidates]


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
    """Candidates, colliding ones solved again with rows that keep clear and make a step several times dearer."""
    again = colliding(scene, candidates, workers)
    if not again:
        return list(candidates)
    work = [targets[k] for k in again]
    engines, points = [guarded(target) for target in work], np.array([target.lower for target in work])
    arm = engines[0].optimisation_problem.arm
    neighbourhood = Neighbourhood.of(arm, work[0].direction, points, among(pairs, again))
    better, _ = best_candidates(engines, work, neighbourhood, workers, seed=seed, progress=progress)
    found = dict(enumerate(candidates)) | dict(zip(again, better, strict=True))
    return list(found.values())


def colliding(scene: Scene, candidates: Sequence[MapCandidate], workers: Workers) -> list[int]:
    """Candidates that come nearer to something than the scene's margin."""
    held = [k for k, candidate in enumerate(candidates) if candidate.best is not None]
    if not held or not scene.active:
        return []
    chunks = [held[i : i + 256] for i in range(0, len(held), 256)]
    postures = [np.array([best.q for k in chunk if (best := candidates[k].best) is not None]) for chunk in chunks]
    clear = workers.in_order(_clear, scene, postures)
    return [k for k, yes in zip(held, chain.from_iterable(clear), strict=True) if not yes]


@recorded(lambda scene, Q: (bool,) * len(Q))
def _clear(scene: Scene, Q: Array) -> list[bool]:
    return [bool(yes) for yes in is_clear(scene, Q)]


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
