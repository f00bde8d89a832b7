"""The objective of the task of a problem, or why there is none to export."""

from __future__ import annotations

from typing import Any

from posture_opt.selection.answer.task_objective import task_objective
from posture_opt.selection.problem_data import ProblemData

_NO_TASK = "the problem has no task: there is no objective to export"
_SEVERAL_TARGETS = (
    "the task has several targets, so no single objective is exported: write one for one of them with --position"
)
_WORKPIECE_ERRS = "the objective counts the errors of the workpiece; the covariance is that of the arm alone"


def objective_or_note(problem: ProblemData) -> tuple[tuple[Any, dict[str, str]] | None, tuple[str, ...]]:
    """The function of `task_objective` with its descriptions, and sentences on what is left out or counted.

    Raises:
        InputError: as of `task_objective`.
    """
    if problem.task is None:
        return None, (_NO_TASK,)
    if problem.task.features or problem.task.on_path:
        return None, (_SEVERAL_TARGETS,)
    return task_objective(problem), () if problem.workpiece_sources.empty else (_WORKPIECE_ERRS,)
