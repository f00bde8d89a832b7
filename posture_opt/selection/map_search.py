"""The best postures of many targets at once: random starts for all of them in batches, then what neighbours know.

Targets that lie side by side mostly have the same best branch of the inverse kinematics, and targets that joint 1 turns
onto each other have the same branches. So each target tries the postures of both: a better posture spreads over the
map, a missing one is found beside a known one, and of equally good ones all targets take the same. What still stands
out from its neighbours is searched again with many more starts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from posture_opt.numerics import Progress
from posture_opt.selection.engine import CandidatePosture, Engine, Recipe
from posture_opt.selection.map_exchange import BETTER, NeighbourExchange
from posture_opt.selection.map_neighbours import Neighbourhood
from posture_opt.selection.map_points import MapCandidate, NeighbourSolves
from posture_opt.selection.map_starts import best_among, better_of, by_engine, freedom, out_of_plane
from posture_opt.selection.task_target import TaskTarget

_CHUNK = 32  # targets that are sought together


Effort = tuple[int, int, int]
"""Random starts of a target where 0, 1, or more ways are left free."""

_FIRST: Effort = (48, 48, 48)  # of every target
_SECOND: Effort = (144, 144, 144)  # of those at the edge of the reach, and of a share of the others
_THIRD: Effort = (96, 288, 288)  # of those that stand out
_SHARE = 0.05  # of the targets, where any way is left free
_ODD = 2e-3  # of the objective: a target so much above what its neighbours let expect stands out
_MOST = 0.03  # of the targets: how many of them are searched again


def best_candidates(
    engines: Sequence[Engine],
    targets: Sequence[TaskTarget],
    neighbourhood: Neighbourhood,
    *,
    seed: int,
    workers: int = 1,
    progress: Progress | None = None,
) -> tuple[list[MapCandidate], NeighbourSolves]:
    """The best candidate of every target (N of them, points), each with the engine that solves it.

    Args:
        neighbourhood: which targets try each other's postures.
        seed: of the random starts; the answer does not depend on ``workers``.
    """
    found: dict[int, MapCandidate] = {}
    for indices, candidates in _explored(range(len(targets)), engines, targets, _FIRST, seed, workers):
        found |= dict(zip(indices, candidates, strict=True))
        if progress is not None:
            progress(len(found), len(targets))
    candidates = [found[k] for k in range(len(targets))]
    share = _SHARE if freedom(engines[0], targets[0]) > 0 else 0.0
    chosen = _to_search_more(candidates, neighbourhood, share, seed)
    for indices, more in _explored(chosen, engines, targets, _SECOND, seed, workers):
        for k, candidate in zip(indices, more, strict=True):
            candidates[k] = better_of(engines[k], targets[k], candidates[k], candidate)
    exchange = NeighbourExchange(engines, targets, neighbourhood, candidates)
    alone = [candidate.best for candidate in candidates]
    rng = np.random.default_rng(seed)
    exchange.spread({k for k, best in enumerate(alone) if best is not None}, rng)
    searched: set[int] = set()
    while odd := _standing_out(exchange, searched):
        searched |= set(odd)
        found_again = _explored(odd, engines, targets, _THIRD, seed, workers)
        better = {
            k for mine, more in found_again for k, one in zip(mine, more, strict=True) if exchange.keep_better(k, one)
        }
        exchange.spread(better, rng)
    solves = _statistics(alone, exchange, searched)
    exchange.agree()
    return exchange.candidates, solves


def _standing_out(exchange: NeighbourExchange, searched: set[int]) -> list[int]:
    """Targets that are worse than their neighbours let expect, the worst first, as many as are still worth a search."""
    excess = exchange.excess()
    left = math.ceil(_MOST * len(excess)) - len(searched)
    odd = [int(k) for k in np.argsort(-excess, kind="stable") if excess[k] > _ODD and int(k) not in searched]
    return odd[: min(max(left, 0), math.ceil(left / 2))]


def _statistics(
    alone: Sequence[CandidatePosture | None], exchange: NeighbourExchange, searched: set[int]
) -> NeighbourSolves:
    now = [candidate.best for candidate in exchange.candidates]
    gains = [1 - new.sigma / old.sigma for old, new in zip(alone, now, strict=True) if old and new and old.sigma > 0]
    better = [gain for gain in gains if gain > BETTER]
    again = {k for k in exchange.tried if alone[k] is not None} | searched
    found = sum(new is not None for new in now) - sum(old is not None for old in alone)
    return NeighbourSolves(len(again), len(better), max(better, default=0.0), found)


def _to_search_more(
    candidates: Sequence[MapCandidate], neighbourhood: Neighbourhood, share: float, seed: int
) -> list[int]:
    """A share of the targets, from which rare branches spread; and all that few random starts arrive at.

    These are where reach begins or ends, and where no start met the requirements. Where no start reached any target,
    all of them.
    """
    reached = np.array([candidate.fate != "not reached" for candidate in candidates])
    if not reached.any():
        return list(range(len(candidates)))
    chosen = reached & (np.random.default_rng(seed).random(len(candidates)) < share)
    chosen |= np.array([candidate.fate == "requirement not met" for candidate in candidates])
    for here, there in neighbourhood.on_grid:
        chosen[here[reached[here] != reached[there]]] = True
    return [int(k) for k in np.flatnonzero(chosen)]


def _explored(
    indices: Sequence[int],
    engines: Sequence[Engine],
    targets: Sequence[TaskTarget],
    effort: Effort,
    seed: int,
    workers: int,
) -> Iterable[tuple[list[int], list[MapCandidate]]]:
    """Chunks of ``indices`` with what `_explore` finds for them."""
    shares = by_engine(engines, indices)
    chunks = [mine[i : i + _CHUNK] for _, mine in shares for i in range(0, len(mine), _CHUNK)]
    work = [[targets[k] for k in chunk] for chunk in chunks]
    if workers == 1 or len(chunks) <= 1:
        for chunk, share in zip(chunks, work, strict=True):
            yield chunk, _explore(engines[chunk[0]], share, chunk, effort, seed)
        return
    with ProcessPoolExecutor(workers) as pool:
        recipes = [engines[chunk[0]].recipe for chunk in chunks]
        same = ([effort] * len(chunks), [seed] * len(chunks))
        yield from zip(chunks, pool.map(_explore_there, recipes, work, chunks, *same), strict=True)


def _explore_there(
    recipe: Recipe, targets: Sequence[TaskTarget], indices: Sequence[int], effort: Effort, seed: int
) -> list[MapCandidate]:
    return _explore(Engine.build(recipe), targets, indices, effort, seed)


def _explore(
    engine: Engine, targets: Sequence[TaskTarget], indices: Sequence[int], effort: Effort, seed: int
) -> list[MapCandidate]:
    """The candidates of some targets by random starts; ``indices`` seed them, each target by its own."""
    candidates = [MapCandidate("not reached", None, math.nan)] * len(targets)
    open_ = [k for k in range(len(targets)) if not out_of_plane(engine, targets[k])]
    if not open_:
        return candidates
    free = min(max(freedom(engine, targets[0]), 0), 2)
    starts = effort[free]
    rngs = [np.random.default_rng([seed, starts, indices[k]]) for k in open_]
    Q = [engine.ik.random_postures(starts, rng) for rng in rngs]
    requests = [engine.request(targets[k], starts, rng) for k, rng in zip(open_, rngs, strict=True)]
    for k, reached in zip(open_, engine.ik.reached(Q, requests), strict=True):
        if len(reached):
            candidates[k] = best_among(engine, targets[k], reached)
    return candidates
