"""What one target of a map does with the postures of its neighbours: ``try_all``, ``try_around`` and ``take_over``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from posture_opt.numerics import Array
from posture_opt.selection.maps.map_candidate import MapCandidate, PackedRow
from posture_opt.selection.maps.map_starts import best_among, freedom, is_near, out_of_plane
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.multistart import distinct, rank
from posture_opt.workers.record_pattern import FINITE, Pattern, recorded

BETTER = 1e-4
"""Of the objective: what is no difference."""
BEND = 40.0
"""Of the objective, over (distance / reach)²: what a posture led so far falls short of its optimum, unless fewer is
known."""

STARTS_AROUND_NEIGHBOUR = 24  # starts about each neighbour's posture, for a target without one
PERTURBATION = 0.2  # rad, or of a slide's stroke: how far from it
WORTH_POLISHING = (
    0.25  # of the objective: a neighbour's posture that lies so far above the best one known is not polished
)
EQUALLY_GOOD = 0.05  # of the objective: the same, where it can be no more than equally good
TURNED_SQUARE = 1e-4  # (distance / reach)²: below it a posture was turned rather than led
MAX_UNPROMISING_TRIALS = 1  # polished of a target in all that do not promise to be better as they are
MAX_TRIALS_AT_ONCE = 4  # polished of a target at once


@dataclass(frozen=True)
class NeighbourStarts:
    """A target and the postures of its neighbours.

    Args:
        target, candidate: with the best posture known there.
        starts: (M, n) postures of neighbours [rad or m], joint 1 moved.
        squares: (M,) of the distance that each is led over, as a part of the reach.
        tried: postures of neighbours that the solver began with before; or, for `take_over`, those that ended at a
            worse optimum.
        bend: of the objective, over a square: what a posture led so far may fall short of its optimum.
        seed: of the random perturbations of the starts.
    """

    target: TaskTarget
    candidate: MapCandidate
    starts: Array
    squares: Sequence[float] = ()
    tried: Sequence[Array] = ()
    bend: float = BEND
    seed: tuple[int, ...] = ()


@dataclass
class Trial:
    """What comes of the trials at one target.

    Args:
        candidate: the best one now; ``better`` says whether it changed.
        tried: postures (n,) that were polished; ``lost`` those that ended at a worse optimum.
        bends: what each gained by polishing, over the squared distance that it was led.
    """

    candidate: MapCandidate
    tried: list[Array] = field(default_factory=list)
    lost: list[Array] = field(default_factory=list)
    bends: list[float] = field(default_factory=list)
    better: bool = False

    def packed(self) -> PackedRow:
        """Numbers and text, to be sent to another process."""
        lists = ([q.tolist() for q in self.tried], [q.tolist() for q in self.lost], list(map(float, self.bends)))
        return [self.candidate.packed(), *lists, self.better]

    @staticmethod
    def pattern(joints: int) -> Pattern:
        """That of `packed`, of an arm with so many joints."""
        postures = [(FINITE,) * joints]
        return (MapCandidate.pattern(joints), postures, postures, [float], bool)

    @classmethod
    def unpacked(cls, row: PackedRow) -> Trial:
        """The one that was packed."""
        candidate, tried, lost, bends, better = row
        return cls(
            MapCandidate.unpacked(candidate), list(map(np.array, tried)), list(map(np.array, lost)), bends, better
        )


def _candidates(engine: Engine, items: Sequence[NeighbourStarts]) -> Pattern:
    """The pattern of a packed candidate for every target."""
    return (MapCandidate.pattern(engine.optimisation_problem.robot.n),) * len(items)


@recorded(lambda engine, items: (Trial.pattern(engine.optimisation_problem.robot.n),) * len(items))
def try_all(engine: Engine, items: Sequence[NeighbourStarts]) -> list[PackedRow]:
    """At every target, polish those postures of neighbours that may become the best one, best first: packed trials."""
    return [_tried(engine, item, led).packed() for item, led in zip(items, _carried_over(engine, items), strict=True)]


@recorded(_candidates)
def try_around(engine: Engine, items: Sequence[NeighbourStarts]) -> list[PackedRow]:
    """Targets without a posture sought about those of their neighbours: packed candidates."""
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


@recorded(_candidates)
def take_over(engine: Engine, items: Sequence[NeighbourStarts]) -> list[PackedRow]:
    """At every target the posture of a neighbour, where it is another one and as good: packed candidates."""
    return [_agreed(engine, item, led).packed() for item, led in zip(items, _carried_over(engine, items), strict=True)]


def gain(posture: CandidatePosture, known: CandidatePosture) -> float:
    """By what share of the objective a posture is better than the known one; negative where it is worse.

    ``(f_known − f) / |f_known|``; both objectives have one scale.
    """
    return (known.objective - posture.objective) / max(abs(known.objective), 1e-9)


def _carried_over(engine: Engine, items: Sequence[NeighbourStarts]) -> list[list[tuple[CandidatePosture, float]]]:
    """For each target the postures that arrive there, with their squares.

    Where a tilt is allowed, each is led with and without its own.
    """
    led: list[list[tuple[CandidatePosture, float]]] = [[] for _ in items]
    pairs = [(i, start) for i, item in enumerate(items) for start in range(len(item.starts))]
    if not pairs:
        return led
    counts = [1 + (item.target.tilt > 0) for item in items]
    asked = [
        engine.request(item.target, count, np.random.default_rng(0)) for item, count in zip(items, counts, strict=True)
    ]
    Q = [np.tile(items[i].starts[start], (counts[i], 1)) for i, start in pairs]
    arrived = engine.ik.reached(Q, [asked[i] for i, _ in pairs])
    rows = [(i, start, q) for (i, start), postures in zip(pairs, arrived, strict=True) for q in postures]
    if rows:
        of = [replace(item.target, scale=_known_scale(item.candidate)).parameters for item in items]
        moved = engine.screened(np.array([q for _, _, q in rows]), np.array([of[i] for i, _, _ in rows]))
        for (i, start, _), posture in zip(rows, moved, strict=True):
            led[i].append((posture, items[i].squares[start]))
    return led


def _tried(engine: Engine, item: NeighbourStarts, led: Sequence[tuple[CandidatePosture, float]]) -> Trial:
    """Polish those postures that may become the best one of a target, best first."""
    trial = Trial(item.candidate, list(item.tried))
    bend = item.bend if freedom(engine, item.target) > 0 else 0.0
    ordered = sorted(led, key=lambda one: rank(one[0]))
    for posture, square in islice(_worth_trying(engine, trial, ordered, bend), MAX_TRIALS_AT_ONCE):
        own = trial.candidate.best
        won = _try(engine, item.target, trial, posture)
        if own is not None and math.isfinite(won):
            trial.bends.append((won - gain(posture, own)) / max(square, TURNED_SQUARE))
        trial.better |= won > BETTER
    return trial


def _worth_trying(
    engine: Engine, trial: Trial, led: Sequence[tuple[CandidatePosture, float]], bend: float
) -> Iterable[tuple[CandidatePosture, float]]:
    """The postures that may win, decided one by one, as better ones are found.

    A posture that was led over a distance falls short of its optimum by about the square of it: what it may still gain
    is the bend times that.
    """
    for posture, square in led:
        own = trial.candidate.best
        if own is None:
            yield posture, square
            continue
        won, short = gain(posture, own), min(bend * square, WORTH_POLISHING)
        other = won + short > BETTER and len(trial.tried) < MAX_UNPROMISING_TRIALS
        other = other and not is_near(engine, posture.q, [own.q, *trial.tried])
        if posture.feasible and (won > BETTER or other):
            yield posture, square


def _try(engine: Engine, target: TaskTarget, trial: Trial, posture: CandidatePosture) -> float:
    """Polish a posture and keep it where it is better; what that gains, as a share."""
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


def _agreed(engine: Engine, item: NeighbourStarts, led: Sequence[tuple[CandidatePosture, float]]) -> MapCandidate:
    """The candidate of a target, or the posture of a neighbour that is as good and another one."""
    candidate = item.candidate
    for posture, _ in led:
        own = candidate.best
        assert own is not None
        alike = len(distinct(np.array([own.q, posture.q]), engine.robot)) == 1
        if alike or gain(posture, own) < -EQUALLY_GOOD or is_near(engine, posture.q, item.tried):
            continue
        end = engine.polished(posture, replace(item.target, scale=candidate.scale))
        if end.feasible and (end.optimal or not own.optimal) and gain(end, own) > -BETTER:
            candidate = MapCandidate("feasible", end, candidate.scale)
    return candidate


def _known_scale(candidate: MapCandidate) -> float:
    """The scale of a candidate; one where none is known yet."""
    return 1.0 if math.isnan(candidate.scale) else candidate.scale


def _about(engine: Engine, q: Array, rng: np.random.Generator) -> Array:
    """(M, n) postures within the limits, perturbed at random about one (n,)."""
    robot = engine.robot
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    slides = np.array([joint.type == "prismatic" for joint in robot.joints])
    stray = PERTURBATION * np.where(slides, upper - lower, 1.0)
    return np.asarray(np.clip(q + stray * rng.normal(size=(STARTS_AROUND_NEIGHBOUR, len(q))), lower, upper))
