"""How long to search: until the best optimum has been found again, and again.

Agreement of independent batches is the stopping rule of an answer, agreement of local searches that of a repeated
solve (a cell of a map, a station of a path).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from posture_opt.numerics import TURN, Progress
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.multistart import (
    MAX_TRIALS_PER_START,
    MultistartResult,
    Sampled,
    as_good,
    feasible_starts,
    multistart,
    rank,
    screened,
)
from posture_opt.workers import Part, opened

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
