"""``screened_search``: many postures compared by their objective, and the solver of the problem started at the best.

For answers that are compared with each other, and not certified one by one: the derivatives of the local search, which
cost more than all else here, are not built, and starts are not repeated until they agree.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.numerics import TURN
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.batches import usual_starts
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.multistart import (
    MAX_TRIALS_PER_START,
    MultistartResult,
    Sampled,
    feasible_starts,
    rank,
    screened,
)

_SCREENED_PER_START = 8  # postures that are compared for each local search that a batch of starts has
_IMPROVED = 12  # at which the solver is started: a 6R wrist has eight branches (Pieper 1968)
# Random postures for each start in ranges that may be left: two rounds, the second a patient one. Of 760 targets that
# arms of 6 and 7 joints meet within ranges drawn at random, most near a corner of them, all are found, as with the 80.
_PREFERRED_TRIALS = 16
_NEAR = 0.35  # rad or m in each joint: what is so near to a better posture leads where that one leads


def screened_search(
    engine: Engine, target: TaskTarget, rng: np.random.Generator, *, preferred: bool = False
) -> MultistartResult | None:
    """The optima that the best of many feasible postures lead to, best first.

    Args:
        preferred: whether the joint ranges are only preferred, and wider ones are searched where nothing is found.

    Returns:
        Nothing found where no posture reaches the target; None where none of those that do meets every requirement,
        where the solver takes no such problem, or where it does not end at an optimum.
    """
    starts = usual_starts(engine)
    Q, tried = feasible_starts(engine, target, starts, rng, _PREFERRED_TRIALS if preferred else MAX_TRIALS_PER_START)
    if not len(Q):
        return MultistartResult(target, (), Sampled.none(engine.robot), 0, tried, 0)
    if not engine.confirming.solvable(target.parameters):
        return None
    more, further = feasible_starts(engine, target, (_SCREENED_PER_START - 1) * starts, rng)
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
    """The first few that have none better nearer than `_NEAR` in every joint that matters, whole turns taken off."""
    joints = [k for k in range(engine.robot.n) if k not in engine.indifferent]
    turn = np.array([TURN if engine.robot.joints[k].type == "revolute" else 0.0 for k in joints])
    Q = np.array([candidate.q[joints] for candidate in best_first])
    chosen: list[CandidatePosture] = []
    for k, candidate in enumerate(best_first):
        apart = Q[:k] - Q[k]
        apart = np.abs(apart - turn * np.rint(apart / TURN))
        if not np.any(np.max(apart, axis=1, initial=0.0) < _NEAR):
            chosen.append(candidate)
        if len(chosen) == _IMPROVED:
            break
    return chosen


def _improved(engine: Engine, start: CandidatePosture, target: TaskTarget) -> CandidatePosture:
    """Where the solver ends from a feasible posture; the posture itself where that is not feasible."""
    outcome = engine.confirming.solve(start.q, target.parameters)
    if not np.all(np.isfinite(outcome.x)):
        return start
    end = engine.candidates(outcome.x[None], target)[0]
    return replace(end, optimal=outcome.optimal, message=outcome.message) if end.feasible else start
