"""The best postures of many targets at once: starts for all of them in one batch, neighbours learn from each other."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from posture_opt.selection.feasible import ROW_TOLERANCE, TOLERANCE, Wish
from posture_opt.selection.goal import Goal
from posture_opt.selection.multistart import Candidate, Engine, Progress, Recipe, distinct, median, rank

Floats = np.ndarray
Fate = Literal["feasible", "not reached", "requirement not met"]
Pairs = Sequence[tuple[np.ndarray, np.ndarray]]

_STARTS = (48, 144)  # of a target, the second number where the first met no requirement
_POLISHED = 4  # of a target where no start meets the further requirements
_CHUNK = 32  # targets that are sought together
_ROUNDS = 4  # of learning from neighbours
_AROUND = 24  # starts about each neighbour's posture, for a target without one
_STRAY = 0.2  # rad, or of a slide's stroke: how far from it
_BETTER = 1e-4  # of the objective: what a neighbour's posture must promise, and what is no difference
_NEAR = 0.05  # of the objective: how far a neighbour's posture may lie above the optimum that it leads to


@dataclass(frozen=True)
class Place:
    """What was found for one target: a posture, or why there is none."""

    fate: Fate
    best: Candidate | None
    scale: float


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
        learnt = _learn(places, engines, goals, neighbours)
        # Both, whatever the first one says.
        if not _try_around(places, engines, goals, neighbours, rng) and not learnt:
            break
    _agree(places, engines, goals, neighbours)
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


def explore(engine: Engine, goals: Sequence[Goal], indices: Sequence[int], seed: int) -> list[Place]:
    """The places of some goals by random starts; ``indices`` seed them, each goal by its own."""
    places = [Place("not reached", None, math.nan)] * len(goals)
    for round_, starts in enumerate(_STARTS):
        open_ = [k for k, place in enumerate(places) if place.best is None]
        open_ = [k for k in open_ if not _out_of_plane(engine, goals[k])]
        if not open_:
            break
        rngs = [np.random.default_rng([seed, round_, indices[k]]) for k in open_]
        Q = np.vstack([engine.ik.random_postures(starts, rng) for rng in rngs])
        wishes = [engine.wish(goals[k], starts, rng) for k, rng in zip(open_, rngs, strict=True)]
        Q, errors = engine.ik.solve(Q, _together(wishes, starts))
        at = np.repeat(open_, starts)
        for k in open_:
            mine = Q[(at == k) & (errors < TOLERANCE)]
            if len(mine):
                places[k] = _polished(engine, goals[k], mine)
    return places


def _together(wishes: Sequence[Wish], count: int) -> Wish:
    """The wishes of ``count`` rows each as one batch."""
    return _of_rows(np.vstack([np.broadcast_to(wish.rows, (count, 16)) for wish in wishes]), wishes[0])


def _of_rows(rows: Floats, like: Wish) -> Wish:
    """A batch of wishes with the weights of another one."""
    return Wish(rows[:, :3], rows[:, 3:6], rows[:, 6:9], like.weights, like.slack, rows[:, 15:])


def _polished(engine: Engine, goal: Goal, Q: Floats) -> Place:
    """The best place among postures (M, n) that reach the goal."""
    _, violation, own, _ = (column[:, 0] for column in engine.screen(Q, goal.parameters()))
    scale = _scale(engine, own)
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


def _scale(engine: Engine, own: Floats) -> float:
    """The variance that the objective is divided by: the median of the postures seen at first."""
    middle = 1.0 if engine.programme.task.criterion == "miss" else median(own)
    return middle if middle > 0 else 1.0


def _learn(places: list[Place], engines: Sequence[Engine], goals: Sequence[Goal], neighbours: Pairs) -> bool:
    """Try the postures of neighbours; whether any place became better."""
    better: dict[int, Candidate] = {}
    for here, there in neighbours:
        pairs = [
            (k, places[j].best)
            for k, j in zip(here.tolist(), there.tolist(), strict=True)
            if places[j].best is not None and engines[j] is engines[k]
        ]
        for engine in {id(engines[k]): engines[k] for k, _ in pairs}.values():
            mine = [(k, best.q) for k, best in pairs if engines[k] is engine and best is not None]
            for k, candidate in _carried_over(engine, goals, places, mine):
                known = places[k].best
                promising = known is None or _gain(candidate, known) > _BETTER
                if promising and (k not in better or rank(candidate) < rank(better[k])):
                    better[k] = candidate
    improved = [_improved(places, engines[k], goals[k], k, candidate) for k, candidate in better.items()]
    return any(improved)


def _try_around(
    places: list[Place], engines: Sequence[Engine], goals: Sequence[Goal], neighbours: Pairs, rng: np.random.Generator
) -> bool:
    """Look for postures of targets without one about those of their neighbours; whether there are any."""
    starts: dict[int, list[Floats]] = {}
    for here, there in neighbours:
        for k, j in zip(here.tolist(), there.tolist(), strict=True):
            best = places[j].best
            if places[k].best is None and best is not None and engines[j] is engines[k]:
                starts.setdefault(k, []).append(_about(engines[k], best.q, rng))
    found = False
    for engine in {id(engines[k]): engines[k] for k in starts}.values():
        mine = [k for k in starts if engines[k] is engine and not _out_of_plane(engine, goals[k])]
        if not mine:
            continue
        Q = [np.vstack(starts[k]) for k in mine]
        wishes = [engine.wish(goals[k], len(q), rng).rows for k, q in zip(mine, Q, strict=True)]
        rows = [np.broadcast_to(wish, (len(q), 16)) for wish, q in zip(wishes, Q, strict=True)]
        reached, errors = engine.ik.solve(np.vstack(Q), _of_rows(np.vstack(rows), engine.wish(goals[mine[0]], 1, rng)))
        at = np.repeat(mine, [len(q) for q in Q])
        for k in mine:
            arrived = reached[(at == k) & (errors < TOLERANCE)]
            if len(arrived):
                places[k] = _polished(engine, goals[k], arrived)
                found |= places[k].best is not None
    return found


def _about(engine: Engine, q: Floats, rng: np.random.Generator) -> Floats:
    """(M, n) postures within the limits about one (n,)."""
    robot = engine.programme.robot
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    stray = _STRAY * np.where(slides, upper - lower, 1.0)
    return np.asarray(np.clip(q + stray * rng.normal(size=(_AROUND, len(q))), lower, upper))


def _out_of_plane(engine: Engine, goal: Goal) -> bool:
    return engine.programme.reach.misses(goal.lower, goal.upper)


def _carried_over(
    engine: Engine, goals: Sequence[Goal], places: Sequence[Place], pairs: Sequence[tuple[int, Floats]]
) -> Iterable[tuple[int, Candidate]]:
    """Postures moved from their own target to that of goal k, where they meet what is required if anything does."""
    rng = np.random.default_rng(0)
    wishes = [engine.wish(goals[k], 1, rng) for k, _ in pairs]
    Q, errors = engine.ik.solve(np.array([q for _, q in pairs]), _together(wishes, 1))
    scales = np.array([1.0 if math.isnan(places[k].scale) else places[k].scale for k, _ in pairs])
    parameters = np.array([goals[k].parameters() for k, _ in pairs])
    parameters[:, -1] = scales
    objective, violation, _, variance = (column[:, 0] for column in engine.screen(Q, parameters))
    sigma = np.sqrt(np.maximum(variance, 0.0))
    for row, (k, _) in enumerate(pairs):
        known = places[k].best
        candidate = Candidate(Q[row], float(objective[row]), float(violation[row]), float(sigma[row]))
        if errors[row] < TOLERANCE and (known is None or candidate.feasible):
            yield k, candidate


def _gain(candidate: Candidate, known: Candidate) -> float:
    """By what share of the objective a candidate is better."""
    return (known.objective - candidate.objective) / max(abs(known.objective), 1e-9)


def _agree(places: list[Place], engines: Sequence[Engine], goals: Sequence[Goal], neighbours: Pairs) -> None:
    """Of equally good postures take the one of the neighbour: a map is read more easily, and an arm moves less.

    From the best place outwards, each target once.
    """
    beside: dict[int, list[int]] = {}
    for here, there in neighbours:
        for k, j in zip(here.tolist(), there.tolist(), strict=True):
            beside.setdefault(j, []).append(k)
    known = {k: place.best for k, place in enumerate(places) if place.best is not None}
    while known:
        front = [min(known, key=lambda k: known[k].sigma)]
        while front:
            for k in front:
                known.pop(k, None)
            pairs = {k: j for j in front for k in beside.get(j, []) if k in known and engines[k] is engines[j]}
            _take_over(places, engines, goals, pairs)
            front = list(pairs)


def _take_over(
    places: list[Place], engines: Sequence[Engine], goals: Sequence[Goal], pairs: dict[int, int]
) -> None:  # fmt: skip
    """At each first target the posture of the second one, where it is another one and as good."""
    for engine in {id(engines[k]): engines[k] for k in pairs}.values():
        mine = [(k, best.q) for k, j in pairs.items() if engines[k] is engine and (best := places[j].best) is not None]
        for k, candidate in _carried_over(engine, goals, places, mine):
            known = places[k].best
            assert known is not None
            alike = len(distinct(np.array([known.q, candidate.q]), engine.programme.robot)) == 1
            if alike or _gain(candidate, known) < -_NEAR:
                continue
            end = engine.polished(candidate, replace(goals[k], scale=places[k].scale))
            if end.feasible and (end.optimal or not known.optimal) and _gain(end, known) > -_BETTER:
                places[k] = Place("feasible", end, places[k].scale)


def _improved(places: list[Place], engine: Engine, goal: Goal, k: int, candidate: Candidate) -> bool:
    known, scale = places[k].best, places[k].scale
    if math.isnan(scale):  # no start had reached this target
        scale = _scale(engine, np.asarray(engine.screen(candidate.q[None], goal.parameters())[2][:, 0]))
        candidate = engine.candidates(candidate.q[None], replace(goal, scale=scale))[0]
    end = engine.polished(candidate, replace(goal, scale=scale))
    if not end.feasible or (known is not None and end.objective >= known.objective):
        return False
    places[k] = Place("feasible", end, scale)
    return True
