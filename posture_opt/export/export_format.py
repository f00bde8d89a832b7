"""``ExportFormat``: what every format of an export shares; ``ExportSource``: what it is made from."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from posture_opt.errors import InputError, Issue
from posture_opt.export.robot_program import MotionRequest, RobotProgram, answer_programs
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.select_posture import select_posture, task_objective
from posture_opt.spec import Spec


@dataclass(frozen=True)
class Exported:
    """File name -> text, and what the format cannot hold.

    Args:
        files: to be written into one folder.
        notes: sentences for the user: effects that are left out, limits that are placeholders.
    """

    files: Mapping[str, str]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ExportSource:
    """A problem, and the motion that answers it, planned only where a format asks for it."""

    problem: ProblemData
    asked: MotionRequest
    seed: int | None = None
    workers: int = 1
    given: RobotProgram | None = None

    @cached_property
    def programs(self) -> list[RobotProgram]:
        """The motion to write: one program, or the parts of a path."""
        if self.given is not None:
            return [self.given]
        answer = select_posture(self.problem, seed=self.seed, workers=self.workers)
        return answer_programs(answer.problem, answer, self.asked)


class ExportFormat(Spec):
    """One format of an export; ``name`` is that of functions, programs and files."""

    summary: ClassVar[str]  # What it is, for lists
    default: ClassVar[str]  # Name where none is given
    reserved: ClassVar[frozenset[str]] = frozenset()  # Names that mean something else in the language
    case_counts: ClassVar[bool] = True  # Whether the language tells names apart by upper and lower case

    name: str = ""

    @abstractmethod
    def write(self, source: ExportSource) -> Exported:
        """The files, by name.

        Raises:
            InputError: the format cannot say it, or the name is none.
        """

    @property
    def stem(self) -> str:
        """The name, checked."""
        name = self.name or self.default
        if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
            raise InputError(Issue(f"{name!r} is no name", ("--name",), name, "use letters, digits and _"))
        words = self.reserved if self.case_counts else {word.lower() for word in self.reserved}
        if (name if self.case_counts else name.lower()) in words:
            raise InputError(Issue(f"{name!r} is a word of the language itself", ("--name",), name, f"use {name}_1"))
        return name


def objective_or_note(problem: ProblemData) -> tuple[tuple[Any, dict[str, str]] | None, tuple[str, ...]]:
    """The function of `task_objective` with its descriptions, and sentences on what is left out or counted."""
    if problem.task is None:
        return None, ("the problem has no task: there is no objective to export",)
    if problem.task.features or problem.task.on_path:
        text = "the task has several targets, so no single objective is exported"
        return None, (f"{text}: write one for one of them with --position",)
    errs = "the objective counts the errors of the workpiece; the covariance is that of the arm alone"
    return task_objective(problem), () if problem.workpiece_sources.empty else (errs,)
