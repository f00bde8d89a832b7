"""A problem in a few lines, for those who work with it in Python.

Facts are cut after two lines; the whole of a problem is its file.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from posture_opt.report.page.presenter import SummaryPresenter
from posture_opt.report.parts.parts import effect_facts, robot_facts, source_facts, workpiece_facts
from posture_opt.report.text.blocks import Summary
from posture_opt.statements.notation import place, stated_length

if TYPE_CHECKING:
    from posture_opt.problem.problem import Problem
    from posture_opt.selection.tasks import Task

_MAX_FACT_LENGTH = 150  # characters of a fact: two lines


class ProblemPresenter(SummaryPresenter["Problem"]):
    """The robot, its scatter and its task, as the summary that ``print`` shows."""

    def summary(self) -> Summary:
        """Robot, effects, sources of error, task, target, and obstacles where there are any."""
        problem: Problem = self.result
        facts = [
            robot_facts(problem)[0],
            *effect_facts(problem),
            *source_facts(problem),
            *workpiece_facts(problem),
            *_task_facts(problem.task),
        ]
        if problem.cell is not None and problem.cell.obstacles:
            facts.append(("Obstacles", ", ".join(obstacle.name for obstacle in problem.cell.obstacles)))
        return Summary(
            f"Problem: {problem.name}",
            tuple((label, textwrap.shorten(text, _MAX_FACT_LENGTH, placeholder=" …")) for label, text in facts),
        )


def _task_facts(task: Task | None) -> list[tuple[str, str]]:
    """What is to be done, along which direction and where."""
    if task is None:
        return [("Task", "none stated")]
    clearance = f", clearance {stated_length(task.clearance)}" if task.clearance else ""
    return [("Task", f"{task.kind}{clearance}"), ("Target", _where(task))]


def _where(task: Task) -> str:
    """Where the tool point has to be: a path, features, a region, anywhere, or one position [mm], world frame."""
    if task.on_path:
        return "along a path"
    if task.features:
        return f"{len(task.features)} features of a workpiece: {', '.join(feature.name for feature in task.features)}"
    if task.region is not None:
        return f"anywhere between {place(task.region.min)} and {place(task.region.max)}"
    return "anywhere in reach" if task.position is None else place(task.position)
