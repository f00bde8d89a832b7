"""``ProgramFormat``: what the languages of controllers share."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from posture_opt.errors import InputError, Issue
from posture_opt.export.export_format import Exported, ExportFormat, ExportSource
from posture_opt.export.robot_program import RobotProgram, plain


class ProgramFormat(ExportFormat):
    """A robot program: it drives to every stop, joint by joint, and waits there.

    Stops are joint values and not poses: the controller's own kinematics, which knows no correction, has no part in
    it.
    """

    default: ClassVar[str] = "posture"
    most_joints: ClassVar[int] = 12
    """That the language can move."""
    comment_mark: ClassVar[str]
    """What a comment begins with, to the end of its line."""

    def write(self, source: ExportSource) -> Exported:
        return self.written(source.program)

    def written(self, program: RobotProgram) -> Exported:
        """A program in this language.

        Raises:
            InputError: the arm has more joints than the language can move.
        """
        if program.robot.n > self.most_joints:
            raise InputError(self._too_many(program.robot.n))
        return Exported(self.files(program), program.notes)

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


def seconds(value: float) -> str:
    """A time as a plain number with a decimal point: 2.0, 0.25."""
    text = f"{value:.3f}".rstrip("0")
    return text + "0" if text.endswith(".") else text
