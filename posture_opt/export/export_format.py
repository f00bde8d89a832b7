"""``ExportFormat``: what every format of an export shares; ``ExportSource``: what it is made from."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from posture_opt.errors import InputError, Issue
from posture_opt.export.robot_program import MotionRequest, RobotProgram, answer_programs
from posture_opt.selection.problem_data import ProblemData
from posture_opt.selection.select_posture import select_posture
from posture_opt.spec import Spec

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


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
    """A problem, and the motion that answers it, planned only where a format asks for it.

    Args:
        problem: what is exported.
        asked: of a program.
        seed, workers: of the planning.
        given: the program, where it is known already.
    """

    problem: ProblemData
    asked: MotionRequest
    seed: int | None = None
    workers: int = 1
    given: RobotProgram | None = None

    @cached_property
    def programs(self) -> list[RobotProgram]:
        """The motion to write: one program, or the parts of a path.

        Raises:
            NoSolutionError, InputError: as of `select_posture`.
        """
        if self.given is not None:
            return [self.given]
        answer = select_posture(self.problem, seed=self.seed, workers=self.workers)
        return answer_programs(answer.problem, answer, self.asked)


class ExportFormat(Spec):
    """One format of an export; ``name`` is that of functions, programs and files.

    A kind has its mathematics and its words in one file; `EXPORTS` lists it, and every command knows it from then on.
    """

    summary: ClassVar[str]
    """What it is, for lists."""
    default: ClassVar[str]
    """Name where none is given."""
    reserved: ClassVar[frozenset[str]] = frozenset()
    """Names that mean something else in the language."""
    case_counts: ClassVar[bool] = True
    """Whether the language tells names apart by upper and lower case."""

    name: str = ""

    @abstractmethod
    def write(self, source: ExportSource) -> Exported:
        """The files, by name.

        Raises:
            InputError: the format cannot say it, or the name is none.
        """

    @property
    def stem(self) -> str:
        """The name, checked.

        Raises:
            InputError: it is no identifier, or a word of the language.
        """
        name = self.name or self.default
        if not _NAME.fullmatch(name):
            raise InputError(Issue(f"{name!r} is no name", ("--name",), name, "use letters, digits and _"))
        words = self.reserved if self.case_counts else {word.lower() for word in self.reserved}
        if (name if self.case_counts else name.lower()) in words:
            raise InputError(Issue(f"{name!r} is a word of the language itself", ("--name",), name, f"use {name}_1"))
        return name
