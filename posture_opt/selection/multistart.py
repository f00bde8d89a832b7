"""Global search: feasible first, then local searches from many starts."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.selection.engine import STEPS, CandidatePosture, Engine, median
from posture_opt.selection.inverse_kinematics import ROW_TOLERANCE, TOLERANCE
from posture_opt.selection.task_target import TaskTarget

_OVERSAMPLING = 2  # random postures for each start wanted at first: of a Panda's two in three arrive
_FIRST_STEPS = 3  # of the local search from every start, before the best ones are chosen
_EFFORT = 80  # random postures for each start wanted at most: then the target counts as out of reach
_RETRIES = (1, 4, 16)  # times the starts, where answers meet the target but not the further requirements
_DISTINCT = math.radians(5.0)  # apart in a joint: well above what a solver leaves open in a flat valley
_DISTINCT_SHIFT = 0.01  # m, the same of a slide
_CLOSE = 0.3  # rad or m: starts nearer to each other than this mostly end at the same optimum


@dataclass(frozen=True)
class Sampled:
    """Feasible postures Q (k, n) that random starts led to, with their σ_max (k,) [m]."""

    robot: Robot = field(repr=False)
    Q: Array = field(repr=False)
    sigma: Array = field(repr=False)

    @classmethod
    def none(cls, robot: Robot) -> Sampled:
        """No posture at all."""
        return cls(robot, np.zeros((0, robot.n)), np.zeros(0))

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
        polished: number of local searches that were followed to their end.
        batches: number of independent searches; ``recurred`` of them ended at the best optimum.
    """

    target: TaskTarget
    found: tuple[CandidatePosture, ...]
    sampled: Sampled
    arrived: int
    tried: int
    polished: int
    batches: int = 1
    recurred: int = 1


def feasible_starts(engine: Engine, target: TaskTarget, count: int, rng: np.random.Generator) -> tuple[Array, int]:
    """About ``count`` postures on the target, and how many random ones that took.

    Fewer mean that the effort, a multiple of ``count``, was used up; an empty array, that thousands of restarts
    found none.
    """
    tried, arrived = 0, np.zeros((0, engine.robot.n))
    size = _OVERSAMPLING * count
    while len(arrived) < count and tried < _EFFORT * count:
        # Points of a region are drawn at first; where none of them is reached, any point of it will do.
        request = engine.request(target, size, rng, whole_box=tried > 0 and not len(arrived))
        Q, errors = engine.ik.solve(engine.ik.random_postures(size, rng), request, enough=count - len(arrived))
        arrived = np.vstack([arrived, Q[errors < TOLERANCE]])
        tried += int(np.count_nonzero(np.isfinite(errors)))  # the others were not needed
        rate = max(len(arrived), 1) / tried
        size = int(min(max(1.5 * (count - len(arrived)) / rate, count / 4), 16 * count))
    return arrived[: 2 * count], tried


def multistart(
    engine: Engine, target: TaskTarget, rng: np.random.Generator, starts: int, polish: int | None = None
) -> MultistartResult:
    """Feasible starts, and the local optima that they lead to.

    Args:
        polish: with a number, all starts take a few steps and only the best distinct ones, so many, the others.

    Starts meet target and tool axis. Where no answer meets the further requirements, many more are tried, and those few
    of them polished that violate them least: they are nearer then.
    """
    found = MultistartResult(target, (), Sampled.none(engine.robot), 0, 0, 0)
    if engine.optimisation_problem.reach.misses(target.lower, target.upper):
        return found
    for more in _RETRIES if engine.optimisation_problem.task.subject_to else _RETRIES[:1]:
        found = _multistart_once(engine, target, rng, more * starts, None if polish is None else more * polish)
        if any(candidate.feasible for candidate in found.found):
            break
    return found


def _multistart_once(
    engine: Engine, target: TaskTarget, rng: np.random.Generator, starts: int, polish: int | None
) -> MultistartResult:
    Q, tried = feasible_starts(engine, target, starts, rng)
    if not len(Q):
        return MultistartResult(target, (), Sampled.none(engine.robot), 0, tried, 0)
    arrived, (target, sampled) = len(Q), _screened(engine, target, Q)
    optima = engine.descended(Q, target, STEPS if polish is None else _FIRST_STEPS)
    if polish is not None:
        order = np.lexsort((optima.objective, np.where(optima.violation <= ROW_TOLERANCE, 0.0, optima.violation)))
        first = order[_spread_out(optima.q[order], polish)]
        optima = engine.descended(optima.q[first], target, STEPS, optima.multipliers[first])
        Q = Q[first]
    found = engine.settled(engine.candidates(Q, target), optima, target)
    return MultistartResult(target, tuple(sorted(found, key=rank)), sampled, arrived, tried, len(found))


def _screened(engine: Engine, target: TaskTarget, Q: Array) -> tuple[TaskTarget, Sampled]:
    """The target with a scale, the postures' median variance where it has none, and those that meet every row."""
    _, violation, own, variance = (column[:, 0] for column in engine.screen(Q, target.parameters()))
    if target.scale == 1.0:
        target = replace(target, scale=engine.scale_of(own))
    met = violation <= ROW_TOLERANCE
    return target, Sampled(engine.robot, Q[met], np.sqrt(np.maximum(variance[met], 0.0)))


def rank(candidate: CandidatePosture) -> tuple[bool, float, bool, float]:
    """Sorting key: feasible ones by objective, then infeasible ones by violation."""
    # Equal to the sixth digit is equal: the solver's word decides, then the posture nearer to the zero posture.
    key = round(candidate.objective, 6) if candidate.feasible else candidate.violation
    return (not candidate.feasible, key, not candidate.optimal, float(np.linalg.norm(candidate.q)))


def distinct(Q: Array, robot: Robot) -> list[int]:
    """Rows of Q (k, n) that differ from every earlier one by more than 5° or 10 mm in a joint, whole turns apart."""
    revolute = np.array([joint.type == "revolute" for joint in robot.joints])
    kept: list[int] = []
    for k, q in enumerate(Q):
        difference = Q[kept] - q
        turned = np.abs((difference + np.pi) % (2 * np.pi) - np.pi)
        apart = np.where(revolute, turned > _DISTINCT, np.abs(difference) > _DISTINCT_SHIFT)
        if np.all(np.any(apart, axis=1)):
            kept.append(k)
    return kept


def _spread_out(Q: Array, count: int) -> list[int]:
    """Rows of Q (N, n), sorted best first, that are not close to a better one; filled up with the best of the rest."""
    chosen: list[int] = []
    for k in range(len(Q)):
        if len(chosen) == count:
            return chosen
        if not chosen or np.min(np.max(np.abs(Q[chosen] - Q[k]), axis=1)) > _CLOSE:
            chosen.append(k)
    rest = [k for k in range(len(Q)) if k not in chosen]
    return sorted((chosen + rest)[:count])
