"""The best postures of many targets at once: starts for all of them in batches, then what neighbours know."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from posture_opt.numerics import Progress
from posture_opt.selection.engine import Engine, Recipe
from posture_opt.selection.goal import Goal
from posture_opt.selection.map_candidates import Place, explore
from posture_opt.selection.neighbours import Pairs, agree, learn, try_around

_CHUNK = 32  # targets that are sought together
_ROUNDS = 4  # of learning from neighbours


def best_places(
    engines: Sequence[Engine],
    goals: Sequence[Goal],
    neighbours: Pairs,
    *,
    seed: int,
    workers: int = 1,
    progress: Progress | None = None,
) -> list[Place]:
    """The best place of every goal (N of them, points), each with the engine that solves it.

    Args:
        neighbours: pairs of index arrays: the postures of the second are tried at the first.
        seed: of the random starts; the answer does not depend on ``workers``.
    """
    chunks = list(_chunks(engines))
    found: dict[int, Place] = {}
    for indices, places in _explored(chunks, engines, goals, seed, workers):
        found |= dict(zip(indices, places, strict=True))
        if progress is not None:
            progress(len(found), len(goals))
    places = [found[k] for k in range(len(goals))]
    rng = np.random.default_rng(seed)
    for _ in range(_ROUNDS):
        learnt = learn(places, engines, goals, neighbours)
        # Both, whatever the first one says.
        if not try_around(places, engines, goals, neighbours, rng) and not learnt:
            break
    agree(places, engines, goals, neighbours)
    return places


def _chunks(engines: Sequence[Engine]) -> Iterable[list[int]]:
    """Indices of goals that one engine serves, some at a time."""
    for engine in {id(e): e for e in engines}.values():
        mine = [k for k, other in enumerate(engines) if other is engine]
        yield from (mine[i : i + _CHUNK] for i in range(0, len(mine), _CHUNK))


def _explored(
    chunks: Sequence[list[int]], engines: Sequence[Engine], goals: Sequence[Goal], seed: int, workers: int
) -> Iterable[tuple[list[int], list[Place]]]:
    if workers == 1 or len(chunks) == 1:
        for chunk in chunks:
            yield chunk, explore(engines[chunk[0]], [goals[k] for k in chunk], chunk, seed)
        return
    with ProcessPoolExecutor(workers) as pool:
        recipes = [engines[chunk[0]].recipe for chunk in chunks]
        shares = [[goals[k] for k in chunk] for chunk in chunks]
        yield from zip(chunks, pool.map(_explore_there, recipes, shares, chunks, [seed] * len(chunks)), strict=True)


def _explore_there(recipe: Recipe, goals: Sequence[Goal], indices: Sequence[int], seed: int) -> list[Place]:
    return explore(Engine.build(recipe), goals, indices, seed)
