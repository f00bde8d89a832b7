"""``explore``: the targets of a chunk by random starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.selection.maps.map_candidate import MapCandidate, PackedRow
from posture_opt.selection.maps.map_starts import best_among, better_of, freedom, out_of_plane
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import Engine

Effort = tuple[int, int, int]
"""Random starts of a target where 0, 1, or more ways are left free."""


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


def explore(engine: Engine, item: Exploration) -> list[PackedRow]:
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
