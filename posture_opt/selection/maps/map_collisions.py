"""The targets of a map whose best posture collides: solved again, with what keeps the arm clear.

Keeping clear makes a step several times dearer, so a map is solved without it first; most cells are clear anyway.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.numerics import Array, Progress
from posture_opt.selection.maps.map_candidate import MapCandidate
from posture_opt.selection.maps.map_neighbours import Neighbourhood, Pairs
from posture_opt.selection.maps.map_search import best_candidates
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.workers import Workers
from posture_opt.workers.record_pattern import recorded

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
