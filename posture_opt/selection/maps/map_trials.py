"""What one target of a map does with starts: random ones, and the postures of its neighbours."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.maps.map_points import MapCandidate, PackedRow
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.multistart import distinct, local_optima, rank
from posture_opt.workers.record_pattern import FINITE, Pattern, recorded

BETTER = 1e-4
"""Of the objective: what is no difference."""
BEND = 40.0
"""Of the objective over (distance / reach)²: what a led posture falls short of its optimum, unless less is known."""
Led = list[tuple[CandidatePosture, float]]
"""Postures that arrive at a target, with the squares of the distances that they were led over."""


def out_of_plane(engine: Engine, target: TaskTarget) -> bool:
    """Whether a target lies outside of the plane, or line, of the tool point."""
    return engine.optimisation_problem.reach.misses(target.lower, target.upper)


def freedom(engine: Engine, target: TaskTarget) -> int:
    """Degrees of freedom that a task at a point leaves; below zero where it is bound twice."""
    problem = engine.optimisation_problem
    held = int(problem.reach.directions.shape[1]) + (0 if target.tilt > 0 else problem.axis_rows)
    return engine.robot.n - held - len(problem.nlp.indifferent)


def best_among(engine: Engine, target: TaskTarget, Q: Array) -> MapCandidate:
    """Best local optimum from postures Q (M, n) [rad or m] that reach the target."""
    own = engine.screen(Q, target.parameters)[2][:, 0]
    scale = engine.scale_of(own)
    best = local_optima(engine, replace(target, scale=scale), Q)[0]
    return MapCandidate("feasible", best, scale) if best.feasible else MapCandidate("requirement not met", None, scale)


def better_of(engine: Engine, target: TaskTarget, first: MapCandidate, second: MapCandidate) -> MapCandidate:
    """The better candidate of one target, the first in a tie, both in the scale of the first."""
    if second.best is None or first.best is None:
        return second if first.best is None and second.status != "not reached" else first
    same = engine.candidates(second.best.q[None], replace(target, scale=first.scale))[0]
    if same.objective >= first.best.objective:
        return first
    return MapCandidate("feasible", replace(second.best, objective=same.objective), first.scale)


def is_near(engine: Engine, q: Array, known: Sequence[Array]) -> bool:
    """Whether a known posture is within 0.3 rad or m in every joint that matters, whole turns aside."""
    if not len(known):
        return False
    away = np.abs(np.array(known) - q)
    revolute = np.array([joint.type == "revolute" for joint in engine.robot.joints])
    away = np.where(revolute, np.minimum(away % (2 * np.pi), 2 * np.pi - away % (2 * np.pi)), away)
    away[:, list(engine.optimisation_problem.nlp.indifferent)] = 0.0
    return bool(np.min(np.max(away, axis=1)) < 0.3)  # mostly one optimum


@dataclass(frozen=True)
class NeighbourStarts:
    """A target and the postures of its neighbours."""

    target: TaskTarget
    candidate: MapCandidate  # the best known there
    starts: Array  # (M, n) postures of neighbours [rad or m], joint 1 moved
    squares: Sequence[float] = ()  # (M,) of the distance that each is led over, as a part of the reach
    tried: Sequence[Array] = ()  # postures that were polished before; for `take_over` those that ended worse
    bend: float = BEND
    seed: tuple[int, ...] = ()  # of the random perturbations of the starts


@dataclass
class Trial:
    """What comes of the trials at one target."""

    candidate: MapCandidate  # the best one now; better says whether it changed
    tried: list[Array] = field(default_factory=list)  # (n,) polished
    lost: list[Array] = field(default_factory=list)  # (n,) polished, to a worse optimum
    bends: list[float] = field(default_factory=list)  # gained by polishing, over the squared distance
    better: bool = False

    def packed(self) -> PackedRow:
        lists = ([q.tolist() for q in self.tried], [q.tolist() for q in self.lost], list(map(float, self.bends)))
        return [self.candidate.packed(), *lists, self.better]

    @staticmethod
    def pattern(joints: int) -> Pattern:
        postures = [(FINITE,) * joints]
        return (MapCandidate.pattern(joints), postures, postures, [float], bool)

    @classmethod
    def unpacked(cls, row: PackedRow) -> Trial:
        candidate, tried, lost, bends, better = row
        of = MapCandidate.unpacked(candidate)
        return cls(of, [np.array(q) for q in tried], [np.array(q) for q in lost], bends, better)


def candidate_patterns(engine: Engine, items: Sequence[object]) -> Pattern:
    """The pattern of a packed candidate for every item."""
    return (MapCandidate.pattern(engine.optimisation_problem.robot.n),) * len(items)


@recorded(lambda engine, items: (Trial.pattern(engine.optimisation_problem.robot.n),) * len(items))
def try_all(engine: Engine, items: Sequence[NeighbourStarts]) -> list[PackedRow]:
    """Polish neighbours' postures that may become the best, best first: packed trials."""
    return [_tried(engine, item, led).packed() for item, led in zip(items, _carried_over(engine, items), strict=True)]


@recorded(candidate_patterns)
def try_around(engine: Engine, items: Sequence[NeighbourStarts]) -> list[PackedRow]:
    """Seek postures about those of neighbours: packed candidates."""
    found = [item.candidate for item in items]
    mine = [k for k, item in enumerate(items) if not out_of_plane(engine, item.target)]
    if mine:
        rngs = [np.random.default_rng(items[k].seed) for k in mine]
        Q = [np.vstack([_about(engine, q, rng) for q in items[k].starts]) for k, rng in zip(mine, rngs, strict=True)]
        requests = [engine.request(items[k].target, len(q), rng) for k, q, rng in zip(mine, Q, rngs, strict=True)]
        for k, reached in zip(mine, engine.ik.reached(Q, requests), strict=True):
            if len(reached):
                found[k] = best_among(engine, items[k].target, reached)
    return [candidate.packed() for candidate in found]


@recorded(candidate_patterns)
def take_over(engine: Engine, items: Sequence[NeighbourStarts]) -> list[PackedRow]:
    """Take neighbours' postures that are others and as good: packed candidates."""
    return [_agreed(engine, item, led).packed() for item, led in zip(items, _carried_over(engine, items), strict=True)]


def gain(posture: CandidatePosture, known: CandidatePosture) -> float:
    """``(f_known − f) / |f_known|``, both in one scale."""
    return (known.objective - posture.objective) / max(abs(known.objective), 1e-9)


def is_better(candidate: MapCandidate, known: MapCandidate) -> bool:
    """Whether a candidate is better than the known one by more than nothing."""
    best, before = candidate.best, known.best
    return best is not None and (before is None or gain(best, before) > BETTER)


def _carried_over(engine: Engine, items: Sequence[NeighbourStarts]) -> list[Led]:
    led: list[Led] = [[] for _ in items]
    pairs = [(i, start) for i, item in enumerate(items) for start in range(len(item.starts))]
    if not pairs:
        return led
    counts = [1 + (item.target.tilt > 0) for item in items]
    asked = [engine.request(i.target, n, np.random.default_rng(0)) for i, n in zip(items, counts, strict=True)]
    Q = [np.tile(items[i].starts[start], (counts[i], 1)) for i, start in pairs]
    arrived = engine.ik.reached(Q, [asked[i] for i, _ in pairs])
    rows = [(i, start, q) for (i, start), postures in zip(pairs, arrived, strict=True) for q in postures]
    if rows:
        scales = [1.0 if math.isnan(item.candidate.scale) else item.candidate.scale for item in items]
        of = [replace(item.target, scale=scale).parameters for item, scale in zip(items, scales, strict=True)]
        moved = engine.screened(np.array([q for _, _, q in rows]), np.array([of[i] for i, _, _ in rows]))
        for (i, start, _), posture in zip(rows, moved, strict=True):
            led[i].append((posture, items[i].squares[start]))
    return led


def _tried(engine: Engine, item: NeighbourStarts, led: Led) -> Trial:
    trial = Trial(item.candidate, list(item.tried))
    bend = item.bend if freedom(engine, item.target) > 0 else 0.0
    ordered = sorted(led, key=lambda one: rank(one[0]))
    for posture, square in islice(_worth_trying(engine, trial, ordered, bend), 4):
        own = trial.candidate.best
        won = _try(engine, item.target, trial, posture)
        if own is not None and math.isfinite(won):
            trial.bends.append((won - gain(posture, own)) / max(square, 1e-4))  # below it a posture was just turned
        trial.better |= won > BETTER
    return trial


def _worth_trying(engine: Engine, trial: Trial, led: Led, bend: float) -> Iterable[tuple[CandidatePosture, float]]:
    for posture, square in led:
        own = trial.candidate.best
        if own is None:
            yield posture, square
            continue
        won, short = gain(posture, own), min(bend * square, 0.25)
        other = won + short > BETTER and len(trial.tried) < 1
        other = other and not is_near(engine, posture.q, [own.q, *trial.tried])
        if posture.feasible and (won > BETTER or other):
            yield posture, square


def _try(engine: Engine, target: TaskTarget, trial: Trial, posture: CandidatePosture) -> float:
    known, scale = trial.candidate.best, trial.candidate.scale
    if math.isnan(scale):  # no start had reached this target
        scale = engine.scale_of(np.asarray(engine.screen(posture.q[None], target.parameters)[2][:, 0]))
        posture = engine.candidates(posture.q[None], replace(target, scale=scale))[0]
    trial.tried.append(posture.q)
    end = engine.polished(posture, replace(target, scale=scale))
    won = -math.inf if not end.feasible else math.inf if known is None else gain(end, known)
    if won < -BETTER:
        trial.lost.append(posture.q)
    if won > 0:
        trial.candidate = MapCandidate("feasible", end, scale)
    return won


def _agreed(engine: Engine, item: NeighbourStarts, led: Led) -> MapCandidate:
    candidate = item.candidate
    for posture, _ in led:
        own = candidate.best
        assert own is not None
        alike = len(distinct(np.array([own.q, posture.q]), engine.robot)) == 1
        if alike or gain(posture, own) < -0.05 or is_near(engine, posture.q, item.tried):
            continue
        end = engine.polished(posture, replace(item.target, scale=candidate.scale))
        if end.feasible and (end.optimal or not own.optimal) and gain(end, own) > -BETTER:
            candidate = MapCandidate("feasible", end, candidate.scale)
    return candidate


def _about(engine: Engine, q: Array, rng: np.random.Generator) -> Array:
    """(M, n) postures within the limits, perturbed at random about one (n,)."""
    robot = engine.robot
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    stray = 0.2 * np.where(slides, upper - lower, 1.0)  # rad, or share of a slide's stroke
    return np.asarray(np.clip(q + stray * rng.normal(size=(24, len(q))), lower, upper))
