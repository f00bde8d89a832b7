"""``with_fallbacks``: the answer to a problem, or to the same one without what it prefers and does not state."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from posture_opt.errors import NoSolutionError
from posture_opt.selection.problem_data import ProblemData

Problem = TypeVar("Problem", bound=ProblemData)
Answer = TypeVar("Answer")


def with_fallbacks(problem: Problem, solve: Callable[[Problem], Answer]) -> Answer:
    """``solve(problem)``; where there is no solution, that of the first `ProblemData.fallback` that has one.

    Raises:
        NoSolutionError: the last one has none either, for the reasons that there are then.
    """
    while (wider := problem.fallback) is not None:
        try:
            return solve(problem)
        except NoSolutionError:
            problem = wider
    return solve(problem)
