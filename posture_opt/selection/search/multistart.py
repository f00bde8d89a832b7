"""Global search: feasible starts, local searches from many of them, until the best optimum was found again and again.

What is found is locally optimal. How likely something better was missed is estimated from how often each optimum was
found (`MultistartResult.unseen_better`), and held against brute force in the tests. Agreement of independent batches
stops the search for an answer, agreement of local searches that of a repeated solve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from posture_opt.numerics import TURN, Array, Codes, Progress
from posture_opt.robot.robot import Robot
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import STEPS, CandidatePosture, Engine, clusters, median
from posture_opt.selection.search.inverse_kinematics import PATIENT_STEPS, ROW_TOLERANCE, TOLERANCE
from posture_opt.selection.search.inverse_kinematics import STEPS as IK_STEPS
from posture_opt.selection.search.local_search import LocalOptima
from posture_opt.workers import Part, opened

SCREENING_STEPS = (4, 4, 4, 4, 8)  # of the local search, after each of which those are given up that promise nothing
MAX_TRIALS_PER_START = 80  # random postures for each start wanted at most: then the target counts as out of reach
RETRY_FACTORS = (1, 4, 16)  # times the starts, where answers meet the target but not the further requirements


@dataclass(frozen=True)
class Sampled:
    """Feasible postures that random starts led to: what a posture without any selection is like."""

    robot: Robot = field(repr=False)
    Q: Array = field(repr=False)  # (k, n) [rad or m]
    sigma: Array = field(repr=False)  # (k,) σ_max [m]

    @classmethod
    def none(cls, robot: Robot) -> Sampled:
        return cls(robot, np.zeros((0, robot.n)), np.zeros(0))

    def joined(self, other: Sampled) -> Sampled:
        return Sampled(self.robot, np.vstack([self.Q, other.Q]), np.concatenate([self.sigma, other.sigma]))

    @cached_property
    def typical(self) -> float:
        """σ_max [m], median over the distinct postures: how often a start found each must not count. NaN for none."""
        if not len(self.Q):
            return math.nan
        return median(self.sigma[distinct(self.Q, self.robot)])

    @property
    def worst(self) -> float:
        """The largest σ_max [m]; NaN for none."""
        return float(np.max(self.sigma)) if len(self.Q) else math.nan


@dataclass(frozen=True)
class MultistartResult:
    """What a global search found."""

    target: TaskTarget  # with the scale of the objectives
    found: tuple[CandidatePosture, ...]  # ends of local searches, best first
    sampled: Sampled  # starts that met every requirement
    arrived: int  # starts on target and tool axis
    tried: int  # random postures
    polished: int  # local searches
    batches: int = 1  # independent
    recurred: int = 1  # of them found the best optimum

    @property
    def hits(self) -> int:
        """How many of the local searches ended at the best optimum."""
        best = as_good(self.found[0].objective)
        return sum(c.count for c in self.found if c.feasible and c.objective <= best)

    @property
    def unseen_better(self) -> float:
        """About the probability that one more start finds a better optimum: the share of optima seen once (Good 1953,
        eq. 9), any rank of a new one being as likely.
        """
        groups: list[list[CandidatePosture]] = []
        for candidate in self.found:
            if groups and candidate.objective <= as_good(groups[-1][0].objective):
                groups[-1].append(candidate)
            else:
                groups.append([candidate])
        singles = sum(sum(c.count for c in group) == 1 for group in groups)
        return singles / max(self.polished, 1) / (len(groups) + 1)

    def with_known(self, engine: Engine, q: Array) -> MultistartResult:
        """The search with the local optimum of a known posture (n,) [rad or m]."""
        own = engine.polished(engine.candidates(q[None], self.target)[0], self.target)
        alone = MultistartResult(self.target, (own,), Sampled.none(engine.robot), 0, 0, 1)
        return replace(self.joined(alone, engine), batches=self.batches, recurred=self.recurred)

    def joined(self, other: MultistartResult, engine: Engine) -> MultistartResult:
        """Two searches at one target and scale as one; equal optima are merged with their counts."""
        sampled = self.sampled.joined(other.sampled)
        both = sorted((*self.found, *other.found), key=rank)
        chosen, count = engine.clusters(np.array([c.q for c in both]), np.array([c.count for c in both]))
        found = tuple(replace(both[k], count=int(n)) for k, n in zip(chosen, count, strict=True))
        counts = (getattr(self, name) + getattr(other, name) for name in ("arrived", "tried", "polished"))
        return MultistartResult(self.target, found, sampled, *counts)


def feasible_starts(
    engine: Engine, target: TaskTarget, count: int, rng: np.random.Generator, trials: int = MAX_TRIALS_PER_START
) -> tuple[Array, int]:
    """About ``count`` postures (k, n) with target and tool axis met, and how many random ones that took."""
    tried, arrived = 0, np.zeros((0, engine.robot.n))
    size = 2 * count  # of a Panda's random postures two in three arrive
    while len(arrived) < count and tried < trials * count:
        # Points of a region are drawn at first; where none of them is reached, any point of it will do.
        none_yet = tried > 0 and not len(arrived)
        request = engine.request(target, size, rng, whole_box=none_yet)
        starts, steps = engine.ik.random_postures(size, rng), PATIENT_STEPS if none_yet else IK_STEPS
        Q, errors = engine.ik.solve(starts, request, count - len(arrived), steps)
        arrived = np.vstack([arrived, Q[errors < TOLERANCE]])
        tried += int(np.count_nonzero(np.isfinite(errors)))  # the others were not needed
        rate = max(len(arrived), 1) / tried
        size = int(min(max(1.5 * (count - len(arrived)) / rate, count / 4), 16 * count))
    return arrived[: 2 * count], tried


def multistart(
    engine: Engine, target: TaskTarget, rng: np.random.Generator, starts: int, *, every: bool = False
) -> MultistartResult:
    """Feasible starts and their local optima: with ``every`` all, else what may be the best.

    Where none meets the further requirements 4, then 16 times as many are tried, unless the elastic problem shows first
    that they cannot be met.
    """
    found = MultistartResult(target, (), Sampled.none(engine.robot), 0, 0, 0)
    if engine.optimisation_problem.reach.excludes(target.lower, target.upper):
        return found
    asked = engine.optimisation_problem
    for more in RETRY_FACTORS if asked.task.subject_to or asked.scene is not None else RETRY_FACTORS[:1]:
        found = _multistart_once(engine, target, rng, more * starts, every)
        if not found.arrived or any(candidate.feasible for candidate in found.found):
            break
        if engine.contacts is None and not _can_be_met(engine, found):
            break
    return found


def _can_be_met(engine: Engine, found: MultistartResult) -> bool:
    starts = np.array([candidate.q for candidate in found.found[:8]])
    least = engine.elastic.least(found.target.parameters, engine.elastic.further, starts)
    return least is not None and least.met


def _multistart_once(
    engine: Engine, target: TaskTarget, rng: np.random.Generator, starts: int, every: bool
) -> MultistartResult:
    Q, tried = feasible_starts(engine, target, starts, rng)
    if not len(Q):
        return MultistartResult(target, (), Sampled.none(engine.robot), 0, tried, 0)
    target, sampled = screened(engine, target, Q)
    found = local_optima(engine, target, Q, every=every)
    return MultistartResult(target, found, sampled, len(Q), tried, len(Q))


def local_optima(engine: Engine, target: TaskTarget, Q: Array, *, every: bool = False) -> tuple[CandidatePosture, ...]:
    """Distinct local optima from Q (N, n), best first; without ``every`` only possible best ones."""
    size = np.ones(len(Q), dtype=int)
    optima, size = _merged(engine, engine.descended(Q, target, SCREENING_STEPS[0]), size, every)
    for steps in (*SCREENING_STEPS[1:], STEPS):
        if np.all(optima.optimal):
            break
        optima = engine.descended(optima.q, target, steps, optima.state)
        optima, size = _merged(engine, optima, size, every or steps == STEPS)
    most = slice(None if every else 12)  # a 6R wrist has eight branches (Pieper 1968)
    return tuple(sorted(engine.settled(optima.rows(most), target, size[most], helped=every), key=rank))


def _merged(engine: Engine, optima: LocalOptima, size: Codes, every: bool) -> tuple[LocalOptima, Codes]:
    """Distinct searches, best first, and how many each stands for; ``size`` (N,) of the given ones."""
    order = _best_first(optima) if every else _promising(optima)
    nearest, size = engine.clusters(optima.q[order], size[order])
    return optima.rows(order[nearest]), size


def as_good(best: float) -> float:
    """The objective up to which an optimum counts as the best one: by the rounding of the criteria."""
    return best + 1e-4 * max(abs(best), 1e-9)


def _best_first(optima: LocalOptima) -> Codes:
    """The order (N,) of some searches: by violation, then by objective."""
    return np.lexsort((optima.objective, optima.excess))


def _promising(optima: LocalOptima) -> Codes:
    met = optima.excess == 0
    limit = as_good(np.min(optima.objective[met])) if np.any(met) else np.inf
    order = _best_first(optima)
    # A start may gain twice what its quadratic model promises
    hope = optima.objective - 2.0 * np.maximum(optima.gain, 0.0)
    return np.asarray(order[(hope <= limit)[order]])


def screened(engine: Engine, target: TaskTarget, Q: Array) -> tuple[TaskTarget, Sampled]:
    """The target, scaled by the postures' median variance by default, and the postures that meet every row."""
    _, violation, own, variance = (column[:, 0] for column in engine.screen(Q, target.parameters))
    if target.scale == 1.0:
        target = replace(target, scale=engine.scale_of(own))
    met = violation <= ROW_TOLERANCE
    return target, Sampled(engine.robot, Q[met], np.sqrt(np.maximum(variance[met], 0.0)))


def rank(candidate: CandidatePosture) -> tuple[bool, float, bool, float]:
    """Sorting key: feasible by objective (six digits, optima first, then near zero), others by violation."""
    # Equal to the sixth digit is equal: the solver's word decides, then the posture nearer to the zero posture.
    key = round(candidate.objective, 6) if candidate.feasible else candidate.violation
    return (not candidate.feasible, key, not candidate.optimal, float(candidate.q @ candidate.q))


def distinct(Q: Array, robot: Robot) -> list[int]:
    """Rows of Q (k, n) more than 5° or 10 mm in a joint from every earlier one, whole turns taken off."""
    return [int(k) for k in clusters(Q, robot)[0]]


S = TypeVar("S")
R = TypeVar("R")

MAX_BATCHES = 12  # batches


def usual_starts(engine: Engine) -> int:
    """Starts of one batch: more where target and tool axis leave more freedom, and so more local optima."""
    return min(32 * max(engine.searched.freedom - 1, 1), 128)


def until_found_often(
    engine: Engine, target: TaskTarget, rng: np.random.Generator, starts: int | None = None
) -> MultistartResult:
    """Starts until four searches agree on the best and one more finds a better one with less than 1 %."""
    whole = multistart(engine, target, rng, starts or usual_starts(engine))
    for _ in range(1, 1 if starts else 6):
        if not any(c.feasible for c in whole.found) or (whole.hits >= 4 and whole.unseen_better <= 0.01):
            break
        whole = whole.joined(multistart(engine, whole.target, rng, usual_starts(engine)), engine)
    if not whole.found or not whole.found[0].feasible:
        return whole
    best = engine.confirmed(whole.found[0], whole.target)
    return whole if best is whole.found[0] else replace(whole, found=tuple(sorted((best, *whole.found[1:]), key=rank)))


def until_recurrence(
    engine: Engine,
    target: TaskTarget,
    seed: int,
    starts: int | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> MultistartResult:
    """Independent batches, seeded by their number, until two (or six, where evidence is thin) found the best optimum.

    Their agreement is evidence that a share of the starts cannot give: starts of one batch are screened against each
    other.
    """
    starts = starts or usual_starts(engine)
    whole = multistart(engine, target, np.random.default_rng([seed, 0]), starts, every=True)
    if not any(candidate.feasible for candidate in whole.found):
        return whole  # requirements that cannot be met are not met by more starts either
    values = [_best(whole)]
    shared = engine, whole.target, seed, starts
    for batch in independent_batches(_batch, shared, range(1, MAX_BATCHES), workers):
        whole = whole.joined(batch, engine)
        values.append(_best(batch))
        if progress is not None:
            progress(len(values), MAX_BATCHES)
        if recurrences(values, as_good) >= _batches_wanted(whole):
            break
    return replace(whole, batches=len(values), recurred=recurrences(values, as_good))


def _batches_wanted(whole: MultistartResult) -> int:
    expected = whole.unseen_better * whole.polished
    # An optimum as easy to find as six agreeing searches is missed once in e⁶ = 400
    sure = whole.hits >= 6 and expected <= 0.05
    return 2 if sure else 6


def recurrences(values: Sequence[float], limit: Callable[[float], float]) -> int:
    """How many of the batches' best objectives (infinite: nothing feasible) are within ``limit`` of the least."""
    best = min(values)
    return sum(value <= limit(best) for value in values) if np.isfinite(best) else 0


def independent_batches(part: Part[S, int, R], shared: S, numbers: range, workers: int) -> Iterator[R]:
    """``part(shared, k)`` of the batches k in their order, as many at a time as there are workers."""
    with opened(workers) as pool:
        for first in range(numbers.start, numbers.stop, workers):
            yield from pool.in_order(part, shared, range(first, min(first + workers, numbers.stop)))


def _best(found: MultistartResult) -> float:
    """The objective of the best feasible posture of a batch; infinite where there is none."""
    feasible = [candidate.objective for candidate in found.found if candidate.feasible]
    return min(feasible, default=float("inf"))


def _batch(shared: tuple[Engine, TaskTarget, int, int], k: int) -> MultistartResult:
    engine, target, seed, starts = shared
    return multistart(engine, target, np.random.default_rng([seed, k]), starts)


# Random postures for each start in ranges that may be left: two rounds, the second a patient one. Of 760 targets that
# arms of 6 and 7 joints meet within ranges drawn at random, most near a corner of them, all are found, as with the 80.
_PREFERRED_TRIALS = 16


def screened_search(
    engine: Engine, target: TaskTarget, rng: np.random.Generator, *, preferred: bool = False
) -> MultistartResult | None:
    """The optima that the best of many feasible postures lead to; nothing found where none reaches the target.

    None: unmet requirements, a problem that the solver does not take, or no optimum. ``preferred``: wider joint ranges
    are searched where nothing is found.
    """
    starts = usual_starts(engine)
    Q, tried = feasible_starts(engine, target, starts, rng, _PREFERRED_TRIALS if preferred else MAX_TRIALS_PER_START)
    if not len(Q):
        return MultistartResult(target, (), Sampled.none(engine.robot), 0, tried, 0)
    if not engine.confirming.solvable(target.parameters):
        return None
    # Eight postures compared for each local search of a batch
    more, further = feasible_starts(engine, target, 7 * starts, rng)
    Q, tried = np.vstack([Q, more]), tried + further
    target, sampled = screened(engine, target, Q)
    chosen = _local_minima(engine, sorted(engine.candidates(sampled.Q, target), key=rank))
    ends = sorted(engine.tidied([_improved(engine, start, target) for start in chosen], target), key=rank)
    if not ends or not (ends[0].optimal and ends[0].feasible):
        return None
    first, count = engine.clusters(np.array([end.q for end in ends]))
    found = tuple(replace(ends[k], count=int(n)) for k, n in zip(first, count, strict=True))
    return MultistartResult(target, found, sampled, len(Q), tried, len(ends))


def _local_minima(engine: Engine, best_first: list[CandidatePosture]) -> list[CandidatePosture]:
    joints = [k for k in range(engine.robot.n) if k not in engine.indifferent]
    turn = np.array([TURN if engine.robot.joints[k].type == "revolute" else 0.0 for k in joints])
    Q = np.array([candidate.q[joints] for candidate in best_first])
    chosen: list[CandidatePosture] = []
    for k, candidate in enumerate(best_first):
        apart = Q[:k] - Q[k]
        apart = np.abs(apart - turn * np.rint(apart / TURN))
        # 0.35 rad or m in each joint leads to the same optimum
        if not np.any(np.max(apart, axis=1, initial=0.0) < 0.35):
            chosen.append(candidate)
        if len(chosen) == 12:  # a 6R wrist has eight branches (Pieper 1968)
            break
    return chosen


def _improved(engine: Engine, start: CandidatePosture, target: TaskTarget) -> CandidatePosture:
    outcome = engine.confirming.solve(start.q, target.parameters)
    if not np.all(np.isfinite(outcome.x)):
        return start
    end = engine.candidates(outcome.x[None], target)[0]
    return replace(end, optimal=outcome.optimal, message=outcome.message) if end.feasible else start
