"""``above_mounting``: the answer above an assumed mounting plane, or without the plane where there is none above it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from posture_opt.errors import NoSolutionError
from posture_opt.selection.problem_data import ProblemData

Problem = TypeVar("Problem", bound=ProblemData)
Answer = TypeVar("Answer")


def above_mounting(problem: Problem, solve: Callable[[Problem], Answer]) -> Answer:
    """``solve(problem)``; where its mounting plane is assumed and leaves no solution, the same without the plane.

    Before that, joints may leave the ranges in which their effects were measured, at the cost of these.

    Raises:
        NoSolutionError: there is none without the plane either, for the reasons that there are then.
    """
    if problem.narrowed:
        try:
            return solve(problem)
        except NoSolutionError:
            problem = problem.anywhere()
    try:
        return solve(problem)
    except NoSolutionError:
        if not problem.above_assumed_mounting:
            raise
    return solve(problem.mounting_dropped())
