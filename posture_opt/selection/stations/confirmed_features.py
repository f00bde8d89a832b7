"""``confirmed_features``: the postures of all features after the solver of the problem was started at each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posture_opt.selection.answer.solution import Solution
from posture_opt.selection.search.confirmed_posture import confirmed


def confirmed_features(solved: Sequence[Solution]) -> list[Solution]:
    """The same answers where the workpiece stands, with what the solver says of each; a better posture is taken.

    Where the postures are chosen by the probability that all succeed, with errors that stay, none of them is the best
    one by itself: these are not asked about.
    """
    return [_confirmed(solution) for solution in solved]


def _confirmed(solution: Solution) -> Solution:
    """One of them, its alternatives with it."""
    assert solution.engine is not None
    given = solution.engine.candidates(solution.q[None], solution.target)[0]
    (best, *_), said = confirmed(solution.engine, [given], solution.target, solution.problem.scene)
    statistics = replace(solution.statistics, confirmation=said)
    if said is not None and said.refutes:
        return replace(solution, status="feasible", statistics=statistics)
    if said is None or not said.taken:
        return replace(solution, statistics=statistics)
    ended = np.vstack([best.q, solution.ended[1:]])
    return replace(solution, q=best.q, ended=ended, statistics=statistics)
