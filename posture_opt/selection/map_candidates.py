"""One place: the best posture for one target, sought together with those of other targets by random starts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from posture_opt.selection.engine import CandidatePosture, Engine
from posture_opt.selection.feasible import ROW_TOLERANCE, TOLERANCE, Wish
from posture_opt.selection.goal import Goal
from posture_opt.selection.multistart import median, rank

Floats = np.ndarray
Fate = Literal["feasible", "not reached", "requirement not met"]

_STARTS = (48, 144)  # of a target, the second number where the first met no requirement
_POLISHED = 4  # of a target where no start meets the further requirements


@dataclass(frozen=True)
class Place:
    """What was found for one target: a posture, or why there is none."""

    fate: Fate
    best: CandidatePosture | None
    scale: float


def explore(engine: Engine, goals: Sequence[Goal], indices: Sequence[int], seed: int) -> list[Place]:
    """The places of some goals by random starts; ``indices`` seed them, each goal by its own."""
    places = [Place("not reached", None, math.nan)] * len(goals)
    for round_, starts in enumerate(_STARTS):
        open_ = [k for k, place in enumerate(places) if place.best is None]
        open_ = [k for k in open_ if not out_of_plane(engine, goals[k])]
        if not open_:
            break
        rngs = [np.random.default_rng([seed, round_, indices[k]]) for k in open_]
        Q = np.vstack([engine.ik.random_postures(starts, rng) for rng in rngs])
        wishes = [engine.wish(goals[k], starts, rng) for k, rng in zip(open_, rngs, strict=True)]
        Q, errors = engine.ik.solve(Q, together(wishes, starts))
        at = np.repeat(open_, starts)
        for k in open_:
            mine = Q[(at == k) & (errors < TOLERANCE)]
            if len(mine):
                places[k] = place_among(engine, goals[k], mine)
    return places


def together(wishes: Sequence[Wish], count: int) -> Wish:
    """The wishes of ``count`` rows each as one batch."""
    return batch_of(np.vstack([np.broadcast_to(wish.rows, (count, 16)) for wish in wishes]), wishes[0])


def batch_of(rows: Floats, like: Wish) -> Wish:
    """A batch of wishes with the weights of another one."""
    return Wish(rows[:, :3], rows[:, 3:6], rows[:, 6:9], like.weights, like.slack, rows[:, 15:])


def out_of_plane(engine: Engine, goal: Goal) -> bool:
    return engine.programme.reach.misses(goal.lower, goal.upper)


def place_among(engine: Engine, goal: Goal, Q: Floats) -> Place:
    """The best place among postures (M, n) that reach the goal."""
    _, violation, own, _ = (column[:, 0] for column in engine.screen(Q, goal.parameters()))
    scale = scale_of(engine, own)
    goal = replace(goal, scale=scale)
    candidates = engine.candidates(Q, goal)
    met = violation <= ROW_TOLERANCE
    if np.any(met):
        chosen = [min((c for c in candidates if c.feasible), key=rank)]
    else:
        chosen = [candidates[k] for k in np.argsort(violation, kind="stable")[:_POLISHED]]
    ends = sorted((engine.polished(candidate, goal) for candidate in chosen), key=rank)
    if not ends[0].feasible:
        return Place("requirement not met", None, scale)
    return Place("feasible", ends[0], scale)


def scale_of(engine: Engine, own: Floats) -> float:
    """The variance that the objective is divided by: the median of the postures seen at first."""
    middle = 1.0 if engine.programme.task.criterion == "miss" else median(own)
    return middle if middle > 0 else 1.0
