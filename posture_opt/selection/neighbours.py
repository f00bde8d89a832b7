"""Targets of a map learn from their neighbours: better postures, missing ones, the same ones where all are alike."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from posture_opt.selection.engine import CandidatePosture, Engine
from posture_opt.selection.feasible import TOLERANCE
from posture_opt.selection.goal import Goal
from posture_opt.selection.map_candidates import Place, batch_of, out_of_plane, place_among, scale_of, together
from posture_opt.selection.multistart import distinct, rank

Floats = np.ndarray
Pairs = Sequence[tuple[np.ndarray, np.ndarray]]
"""Targets, and as many others whose postures are tried there."""

_AROUND = 24  # starts about each neighbour's posture, for a target without one
_STRAY = 0.2  # rad, or of a slide's stroke: how far from it
_BETTER = 1e-4  # of the objective: what a neighbour's posture must promise, and what is no difference
_NEAR = 0.05  # of the objective: how far a neighbour's posture may lie above the optimum that it leads to


def learn(places: list[Place], engines: Sequence[Engine], goals: Sequence[Goal], neighbours: Pairs) -> bool:
    """Try the postures of neighbours; whether any place became better."""
    better: dict[int, CandidatePosture] = {}
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


def try_around(
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
        mine = [k for k in starts if engines[k] is engine and not out_of_plane(engine, goals[k])]
        if not mine:
            continue
        Q = [np.vstack(starts[k]) for k in mine]
        wishes = [engine.wish(goals[k], len(q), rng).rows for k, q in zip(mine, Q, strict=True)]
        rows = [np.broadcast_to(wish, (len(q), 16)) for wish, q in zip(wishes, Q, strict=True)]
        reached, errors = engine.ik.solve(np.vstack(Q), batch_of(np.vstack(rows), engine.wish(goals[mine[0]], 1, rng)))
        at = np.repeat(mine, [len(q) for q in Q])
        for k in mine:
            arrived = reached[(at == k) & (errors < TOLERANCE)]
            if len(arrived):
                places[k] = place_among(engine, goals[k], arrived)
                found |= places[k].best is not None
    return found


def _about(engine: Engine, q: Floats, rng: np.random.Generator) -> Floats:
    """(M, n) postures within the limits about one (n,)."""
    robot = engine.programme.robot
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    stray = _STRAY * np.where(slides, upper - lower, 1.0)
    return np.asarray(np.clip(q + stray * rng.normal(size=(_AROUND, len(q))), lower, upper))


def _carried_over(
    engine: Engine, goals: Sequence[Goal], places: Sequence[Place], pairs: Sequence[tuple[int, Floats]]
) -> Iterable[tuple[int, CandidatePosture]]:
    """Postures moved from their own target to that of goal k, where they meet what is required if anything does."""
    rng = np.random.default_rng(0)
    wishes = [engine.wish(goals[k], 1, rng) for k, _ in pairs]
    Q, errors = engine.ik.solve(np.array([q for _, q in pairs]), together(wishes, 1))
    scales = np.array([1.0 if math.isnan(places[k].scale) else places[k].scale for k, _ in pairs])
    parameters = np.array([goals[k].parameters() for k, _ in pairs])
    parameters[:, -1] = scales
    objective, violation, _, variance = (column[:, 0] for column in engine.screen(Q, parameters))
    sigma = np.sqrt(np.maximum(variance, 0.0))
    for row, (k, _) in enumerate(pairs):
        known = places[k].best
        candidate = CandidatePosture(Q[row], float(objective[row]), float(violation[row]), float(sigma[row]))
        if errors[row] < TOLERANCE and (known is None or candidate.feasible):
            yield k, candidate


def _gain(candidate: CandidatePosture, known: CandidatePosture) -> float:
    """By what share of the objective a candidate is better."""
    return (known.objective - candidate.objective) / max(abs(known.objective), 1e-9)


def _improved(places: list[Place], engine: Engine, goal: Goal, k: int, candidate: CandidatePosture) -> bool:
    known, scale = places[k].best, places[k].scale
    if math.isnan(scale):  # no start had reached this target
        scale = scale_of(engine, np.asarray(engine.screen(candidate.q[None], goal.parameters())[2][:, 0]))
        candidate = engine.candidates(candidate.q[None], replace(goal, scale=scale))[0]
    end = engine.polished(candidate, replace(goal, scale=scale))
    if not end.feasible or (known is not None and end.objective >= known.objective):
        return False
    places[k] = Place("feasible", end, scale)
    return True


def agree(places: list[Place], engines: Sequence[Engine], goals: Sequence[Goal], neighbours: Pairs) -> None:
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
