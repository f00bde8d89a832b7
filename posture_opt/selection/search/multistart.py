"""Global search: feasible first, then local searches from many starts.

What is found is locally optimal. How likely something better was missed is estimated from how often each optimum was
found (`MultistartResult.unseen_better`), and held against brute force in the tests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.clusters import clusters
from posture_opt.selection.search.engine import STEPS, CandidatePosture, Engine, median
from posture_opt.selection.search.inverse_kinematics import PATIENT_STEPS, ROW_TOLERANCE, TOLERANCE
from posture_opt.selection.search.inverse_kinematics import STEPS as IK_STEPS
from posture_opt.selection.search.local_search import LocalOptima

STARTS_PER_ARRIVAL = 2  # random postures for each start wanted at first: of a Panda's two in three arrive
SCREENING_STEPS = (4, 4, 4, 4, 8)  # of the local search, after each of which those are given up that promise nothing
PROMISED_GAIN_FACTOR = 2.0  # times the gain of a quadratic model: what a start may still gain
MAX_DISTINCT_OPTIMA = 12  # local optima that a repeated solve keeps: a 6R wrist has eight branches (Pieper 1968)
OPTIMUM_TOLERANCE = 1e-4  # of the objective
MAX_TRIALS_PER_START = 80  # random postures for each start wanted at most: then the target counts as out of reach
ELASTIC_STARTS = 8  # best ends of searches, from which the requirements are asked to give as little as they can
RETRY_FACTORS = (1, 4, 16)  # times the starts, where answers meet the target but not the further requirements


@dataclass(frozen=True)
class Sampled:
    """Feasible postures Q (k, n) [rad or m] that random starts led to, with their σ_max (k,) [m].

    They are what a posture without any selection would be like: the gain over a typical posture is against their
    median.
    """

    robot: Robot = field(repr=False)
    Q: Array = field(repr=False)
    sigma: Array = field(repr=False)

    @classmethod
    def none(cls, robot: Robot) -> Sampled:
        """No posture at all."""
        return cls(robot, np.zeros((0, robot.n)), np.zeros(0))

    def joined(self, other: Sampled) -> Sampled:
        """The postures of both, in this order."""
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
    """What a global search found.

    Args:
        target: with the scale that the objectives are divided by.
        found: where the local searches ended, best first; feasible before infeasible.
        sampled: the starts that met every requirement before they were improved.
        arrived: how many starts met target and tool axis.
        tried: random postures that were led towards the target.
        polished: number of local searches.
        batches: number of independent batches of starts; ``recurred`` of them found the best optimum.
    """

    target: TaskTarget
    found: tuple[CandidatePosture, ...]
    sampled: Sampled
    arrived: int
    tried: int
    polished: int
    batches: int = 1
    recurred: int = 1

    @property
    def hits(self) -> int:
        """How many of the local searches ended at the best optimum."""
        best = as_good(self.found[0].objective)
        return sum(c.count for c in self.found if c.feasible and c.objective <= best)

    @property
    def unseen_better(self) -> float:
        """About the probability that one more start leads to an optimum not seen yet that is better than all.

        The share of starts that lead to unseen optima is about that of optima seen once (Good 1953, eq. 9); any rank of
        a new one among the others is as likely. Optima of one value count as one.
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
        """The same search and the local optimum that a known posture (n,) [rad or m] leads to."""
        own = engine.polished(engine.candidates(q[None], self.target)[0], self.target)
        alone = MultistartResult(self.target, (own,), Sampled.none(engine.robot), 0, 0, 1)
        return replace(self.joined(alone, engine), batches=self.batches, recurred=self.recurred)

    def joined(self, other: MultistartResult, engine: Engine) -> MultistartResult:
        """Both searches as one; they have the same target and scale, and equal optima are merged with their counts."""
        sampled = self.sampled.joined(other.sampled)
        both = sorted((*self.found, *other.found), key=rank)
        chosen, count = engine.clusters(np.array([c.q for c in both]), np.array([c.count for c in both]))
        found = tuple(replace(both[k], count=int(n)) for k, n in zip(chosen, count, strict=True))
        counts = (getattr(self, name) + getattr(other, name) for name in ("arrived", "tried", "polished"))
        return MultistartResult(self.target, found, sampled, *counts)


def feasible_starts(
    engine: Engine, target: TaskTarget, count: int, rng: np.random.Generator, trials: int = MAX_TRIALS_PER_START
) -> tuple[Array, int]:
    """About ``count`` postures (k, n) on the target, and how many random ones that took.

    Fewer mean that the effort, a multiple of ``count``, was used up; an empty array, that thousands of restarts found
    none. Target and tool axis are met; further requirements are not looked at. ``trials`` is how many random postures
    each of ``count`` is worth at most.
    """
    tried, arrived = 0, np.zeros((0, engine.robot.n))
    size = STARTS_PER_ARRIVAL * count
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
    """Feasible starts, and the local optima that they lead to; all of these with ``every``, else what may be the best.

    Starts meet target and tool axis. Where no answer meets the further requirements, many more are tried: 4, then 16
    times as many, unless the elastic problem shows first that they cannot be met; with exact distances, starts cost
    less than to build it.

    Args:
        starts: postures on the target that are wanted.
        every: follow each search to its end: for alternatives and for statistics.
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
    """Whether the further requirements can be met, with target and tool axis, from where the best searches ended.

    Interior-point steps with requirements that may give find a way where thousands of restarts do not, and show within
    a tenth of a second that there is none.
    """
    starts = np.array([candidate.q for candidate in found.found[:ELASTIC_STARTS]])
    least = engine.elastic.least(found.target.parameters, engine.elastic.further, starts)
    return least is not None and least.met


def _multistart_once(
    engine: Engine, target: TaskTarget, rng: np.random.Generator, starts: int, every: bool
) -> MultistartResult:
    """One search of that many starts."""
    Q, tried = feasible_starts(engine, target, starts, rng)
    if not len(Q):
        return MultistartResult(target, (), Sampled.none(engine.robot), 0, tried, 0)
    target, sampled = screened(engine, target, Q)
    found = local_optima(engine, target, Q, every=every)
    return MultistartResult(target, found, sampled, len(Q), tried, len(Q))


def local_optima(engine: Engine, target: TaskTarget, Q: Array, *, every: bool = False) -> tuple[CandidatePosture, ...]:
    """The distinct local optima that postures Q (N, n) on a target with its scale lead to, best first.

    All of them with ``every``, else those that may be the best. After `SCREENING_STEPS` steps, searches that promise
    nothing are given up and searches that have met are followed once.
    """
    size = np.ones(len(Q), dtype=int)
    optima, size = _merged(engine, engine.descended(Q, target, SCREENING_STEPS[0]), size, every)
    for steps in (*SCREENING_STEPS[1:], STEPS):
        if np.all(optima.optimal):
            break
        optima = engine.descended(optima.q, target, steps, optima.state)
        optima, size = _merged(engine, optima, size, every or steps == STEPS)
    most = slice(None if every else MAX_DISTINCT_OPTIMA)
    return tuple(sorted(engine.settled(optima.rows(most), target, size[most], helped=every), key=rank))


def _merged(engine: Engine, optima: LocalOptima, size: Codes, every: bool) -> tuple[LocalOptima, Codes]:
    """Those of some searches that differ, best first, all of them or what is promising; and how many searches each is.

    Args:
        size: (N,) how many searches each of the given ones is.
    """
    order = _best_first(optima) if every else _promising(optima)
    nearest, size = engine.clusters(optima.q[order], size[order])
    return optima.rows(order[nearest]), size


def as_good(best: float) -> float:
    """The objective up to which an optimum counts as the best one: by the rounding of the criteria."""
    return best + OPTIMUM_TOLERANCE * max(abs(best), 1e-9)


def _best_first(optima: LocalOptima) -> Codes:
    """The order (N,) of some searches: by violation, then by objective."""
    return np.lexsort((optima.objective, optima.excess))


def _promising(optima: LocalOptima) -> Codes:
    """Those of some searches that may still get below the best one, by what Newton's model promises; best first."""
    met = optima.excess == 0
    limit = as_good(np.min(optima.objective[met])) if np.any(met) else np.inf
    order = _best_first(optima)
    hope = optima.objective - PROMISED_GAIN_FACTOR * np.maximum(optima.gain, 0.0)
    return np.asarray(order[(hope <= limit)[order]])


def screened(engine: Engine, target: TaskTarget, Q: Array) -> tuple[TaskTarget, Sampled]:
    """The target with a scale, the postures' median variance where it has none, and those that meet every row."""
    _, violation, own, variance = (column[:, 0] for column in engine.screen(Q, target.parameters))
    if target.scale == 1.0:
        target = replace(target, scale=engine.scale_of(own))
    met = violation <= ROW_TOLERANCE
    return target, Sampled(engine.robot, Q[met], np.sqrt(np.maximum(variance[met], 0.0)))


def rank(candidate: CandidatePosture) -> tuple[bool, float, bool, float]:
    """Sorting key: feasible ones by objective, then infeasible ones by violation.

    Objectives that agree to the sixth digit count as equal: then an optimum goes before a point that is none, and the
    posture nearer to the zero posture before the others, so that equal runs give equal answers.
    """
    # Equal to the sixth digit is equal: the solver's word decides, then the posture nearer to the zero posture.
    key = round(candidate.objective, 6) if candidate.feasible else candidate.violation
    return (not candidate.feasible, key, not candidate.optimal, float(candidate.q @ candidate.q))


def distinct(Q: Array, robot: Robot) -> list[int]:
    """Indices of the rows of Q (k, n) that differ from every earlier one by more than 5° or 10 mm in a joint.

    Whole turns of a joint make no difference.
    """
    return [int(k) for k in clusters(Q, robot)[0]]
