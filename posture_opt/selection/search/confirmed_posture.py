"""``confirmed``: the best of a few optima after the solver of the problem has been started at each of them.

Two methods that share nothing but the program, its first and second derivatives, end at one optimum or at two. Where
they differ the better one is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posture_opt.collision.scene import Scene
from posture_opt.selection.program.task_target import TaskTarget
from posture_opt.selection.search.confirmation import Confirmation
from posture_opt.selection.search.engine import CandidatePosture, Engine
from posture_opt.selection.search.search_outcome import is_clear
from posture_opt.selection.solvers import Outcome

_BETTER = 1e-6  # of the objective: what agrees to the sixth digit is as good, and the tidier joint values stay
_NO_SIGMA_M = 1e-9  # of a standard deviation below it no share is asked for: arms exist whose errors cancel
_MAX_RIVALS = 2  # other optima that go through the solver too
_RIVAL_GAP = 0.02  # of the objective: an optimum that is worse by more is the best one by no difference of two methods


def confirmed(
    engine: Engine, best_first: Sequence[CandidatePosture], target: TaskTarget, scene: Scene
) -> tuple[list[CandidatePosture], Confirmation | None]:
    """The postures after the solver of the problem has been started at the best few, and what it says of the best one.

    None where the rows are more than the joints, as of an arm that meets some of them by its build.

    Args:
        best_first: feasible postures of a search.
        scene: what the ends keep clear of, by exact distances.
    """
    given = best_first[0]
    if not engine.confirming.solvable(target.parameters):
        return list(best_first), None
    ends = [_ended(engine, start, target, scene) for start in (given, *_rivals(best_first))]
    iterations = sum(one.iterations for _, one in ends)
    own = ends[0][1]
    best, confirmation = given, own
    for end, one in ends:
        if end is not None and end.objective < best.objective - _BETTER * max(1.0, abs(best.objective)):
            end = engine.tidied([end], target)[0]
            best, confirmation = end, replace(one, agrees=max(own.agrees, _apart(end, given)), taken=True)
    if best is given and ends[0][0] is not None and not own.differs:
        best = replace(given, optimal=True)
    every = [best, *best_first]
    left = engine.clusters(np.array([one.q for one in every]))[0]
    return [every[k] for k in left], replace(confirmation, iterations=iterations)


def _rivals(best_first: Sequence[CandidatePosture]) -> Sequence[CandidatePosture]:
    """The optima next to the best one; those that are as good, such as mirror images, are none."""
    best = best_first[0].objective
    more = [(one.objective - best) / max(abs(best), _BETTER) for one in best_first[1:]]
    near = [one for one, gap in zip(best_first[1:], more, strict=True) if _BETTER < gap <= _RIVAL_GAP]
    return near[:_MAX_RIVALS]


def _ended(
    engine: Engine, start: CandidatePosture, target: TaskTarget, scene: Scene
) -> tuple[CandidatePosture | None, Confirmation]:
    """Where the solver ends from a posture, None where that is no optimum of what is asked for; and what it says.

    Where it leaves the posture for a worse one, it is tried once more with the barrier that it has for other starts.
    """
    parameters = target.parameters
    first = _said(engine, start, target, scene, engine.confirming.solve(start.q, parameters))
    if not first[1].differs or (first[0] is not None and first[0].objective < start.objective):
        return first
    ends = engine.optimisation_problem.nlp.ends(parameters)
    again = _said(engine, start, target, scene, engine.fallback_solver(start.q, parameters, ends))
    return again if again[0] is not None and (first[0] is None or again[0].objective < first[0].objective) else first


def _said(
    engine: Engine, start: CandidatePosture, target: TaskTarget, scene: Scene, outcome: Outcome
) -> tuple[CandidatePosture | None, Confirmation]:
    """The same of one outcome."""
    if not np.all(np.isfinite(outcome.x)):
        return None, Confirmation(engine.solver.kind, outcome.iterations, np.nan, np.nan)
    end = engine.candidates(outcome.x[None], target)[0]
    end = replace(end, optimal=outcome.optimal, message=outcome.message, count=start.count)
    said = Confirmation(
        engine.solver.kind, outcome.iterations, outcome.residual, _apart(end, start), False,
        outcome.x, outcome.row_multipliers, outcome.bound_multipliers,
    )  # fmt: skip
    does = outcome.optimal and end.feasible and bool(is_clear(scene, end.q[None])[0])
    return (end if does else None), said


def _apart(end: CandidatePosture, start: CandidatePosture) -> float:
    """Relative difference of two standard deviations."""
    return abs(end.sigma - start.sigma) / max(end.sigma, start.sigma, _NO_SIGMA_M)
