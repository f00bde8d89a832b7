"""``ProgramFormat``: what the languages of controllers share."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import ClassVar

from posture_opt.errors import InputError, Issue
from posture_opt.export.export_format import Exported, ExportFormat, ExportSource
from posture_opt.export.maker import maker_of
from posture_opt.export.robot_program import RobotProgram, plain
from posture_opt.robot.robot import Robot

_TOOL_DATA = (
    "The tool data is that of the model, in its flange frame: check that the controller's flange frame is the same."
)
_ROBOT_AXES = 6
"""Axes of a robot in the languages of controllers; more are external ones."""


class ProgramFormat(ExportFormat):
    """A robot program: it drives to every stop, joint by joint or with the tool on a line, and waits there.

    Stops are joint values and not poses: the controller's own kinematics, which knows no correction, only has a part in
    the way between two points of a line.
    """

    default: ClassVar[str] = "posture"
    most_joints: ClassVar[int] = 12
    """That the language can move."""
    maker: ClassVar[str] = ""
    """Whose controllers read it, as `MAKERS` names them; empty: anybody's."""
    comment_mark: ClassVar[str]
    """What a comment begins with, to the end of its line."""

    def write(self, source: ExportSource) -> Exported:
        programs, stem = source.programs, self.stem
        if len(programs) == 1:
            return self.written(programs[0])
        parts = [self.model_copy(update={"name": f"{stem}_{k}"}).written(p) for k, p in enumerate(programs, start=1)]
        notes = dict.fromkeys(note for part in parts for note in part.notes)
        return Exported({name: text for part in parts for name, text in part.files.items()}, tuple(notes))

    def written(self, program: RobotProgram) -> Exported:
        """A program in this language.

        Raises:
            InputError: the arm has more joints than the language can move.
        """
        if program.robot.n > self.most_joints:
            raise InputError(self._too_many(program.robot.n))
        tool = (_TOOL_DATA,) if program.has_lines and self.maker else ()
        names = [program.robot.joint_names[j] for j in axes_of(program.robot)[1]] if self.maker else []
        external = (f"External axes, in this order: {', '.join(names)}.",) if names else ()
        program = replace(program, notes=(*self._other_maker(program.robot), *external, *tool, *program.notes))
        return Exported(self.files(program), program.notes)

    def _other_maker(self, robot: Robot) -> tuple[str, ...]:
        """A note where the arm is not of the maker whose controllers read this."""
        maker = maker_of(robot.name)
        if not maker or not self.maker or maker == self.maker:
            return ()
        return (f"The arm is a {robot.name}, and this is a program for controllers of {self.maker}.",)

    @abstractmethod
    def files(self, program: RobotProgram) -> dict[str, str]:
        """File name -> text of a program, in the language of the controller."""

    def comments(self, *texts: str) -> list[str]:
        """A line of comment for each text that is not empty, in printable ASCII: nothing in it can end the line."""
        return [f"{self.comment_mark} {plain(text)}" for text in texts if text]

    def _too_many(self, joints: int) -> Issue:
        """The issue of an arm with more joints than the language can move."""
        message = f"the arm has {joints} joints, and a program of this kind moves {self.most_joints}"
        return Issue(message, ("--to",), self.summary.split(":")[0], "use --to jointstate")


def axes_of(robot: Robot) -> tuple[list[int], list[int]]:
    """Which joints are the six axes of the robot in the languages of controllers, and which its external ones.

    A rail in front of six joints that turn is external, and so is what is behind the sixth axis.

    >>> import posture_opt as po
    >>> axes_of(po.load_problem("insert_panda").robot)
    ([0, 1, 2, 3, 4, 5], [6])
    """
    every = list(range(robot.n))
    rail = next((k for k in every if robot.joints[k].type == "revolute"), 0)
    first = min(rail, max(robot.n - _ROBOT_AXES, 0))
    return every[first : first + _ROBOT_AXES], [*every[:first], *every[first + _ROBOT_AXES :]]


def seconds(value: float) -> str:
    """A time as a plain number with a decimal point: 2.0, 0.25."""
    text = f"{value:.3f}".rstrip("0")
    return text + "0" if text.endswith(".") else text
