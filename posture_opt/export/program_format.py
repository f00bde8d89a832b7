"""``ProgramFormat``: what the languages of controllers share."""

from __future__ import annotations

import re
from abc import abstractmethod
from dataclasses import replace
from typing import ClassVar

from posture_opt.errors import InputError, Issue
from posture_opt.export.export_format import Exported, ExportFormat, ExportSource
from posture_opt.export.robot_program import RobotProgram, plain
from posture_opt.robot.robot import Robot

_TOOL_DATA = (
    "The tool data is that of the model, in its flange frame: check that the controller's flange frame is the same."
)
_ROBOT_AXES = 6  # Axes of a robot in the languages of controllers; more are external ones


class ProgramFormat(ExportFormat):
    """A robot program: it drives to every stop, joint by joint or with the tool on a line, and waits there."""

    default: ClassVar[str] = "posture"
    most_joints: ClassVar[int] = 12  # That the language can move
    maker: ClassVar[str] = ""  # Whose controllers read it, as `MAKERS` names them; empty: anybody's
    comment_mark: ClassVar[str]  # What a comment begins with, to the end of its line

    def write(self, source: ExportSource) -> Exported:
        programs, stem = source.programs, self.stem
        if len(programs) == 1:
            return self.written(programs[0])
        parts = [self.model_copy(update={"name": f"{stem}_{k}"}).written(p) for k, p in enumerate(programs, start=1)]
        notes = dict.fromkeys(note for part in parts for note in part.notes)
        return Exported({name: text for part in parts for name, text in part.files.items()}, tuple(notes))

    def written(self, program: RobotProgram) -> Exported:
        """A program in this language."""
        if program.robot.n > self.most_joints:
            raise InputError(self._too_many(program.robot.n))
        tool = (_TOOL_DATA,) if program.has_lines and self.maker else ()
        names = [program.robot.joint_names[j] for j in axes_of(program.robot)[1]] if self.maker else []
        external = (f"External axes, in this order: {', '.join(names)}.",) if names else ()
        program = replace(program, notes=(*self._other_maker(program.robot), *external, *tool, *program.notes))
        return Exported(self.files(program), program.notes)

    def _other_maker(self, robot: Robot) -> tuple[str, ...]:
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
        message = f"the arm has {joints} joints, and a program of this kind moves {self.most_joints}"
        return Issue(message, ("--to",), self.summary.split(":")[0], "use --to jointstate")


def axes_of(robot: Robot) -> tuple[list[int], list[int]]:
    """Which joints are the six axes of the robot in the languages of controllers, and which its external ones."""
    every = list(range(robot.n))
    rail = next((k for k in every if robot.joints[k].type == "revolute"), 0)
    first = min(rail, max(robot.n - _ROBOT_AXES, 0))
    return every[first : first + _ROBOT_AXES], [*every[:first], *every[first + _ROBOT_AXES :]]


def seconds(value: float) -> str:
    """A time as a plain number with a decimal point: 2.0, 0.25."""
    text = f"{value:.3f}".rstrip("0")
    return text + "0" if text.endswith(".") else text


# Maker -> what names of its arms hold, in lower case, blanks for other characters than letters and digits.
MAKERS = {
    "Universal Robots": r"universal robots|(?<![a-z])ur ?\d+e?(?![a-z0-9])",
    "KUKA": r"kuka|iiwa|(?<![a-z])(kr|lbr) ?\d",
    "ABB": r"(?<![a-z])abb(?![a-z])|(?<![a-z])(irb|crb) ?\d|gofa|yumi",
    "FANUC": r"fanuc|lr ?mate|(?<![a-z])crx",
    "Yaskawa": r"yaskawa|motoman|(?<![a-z])gp\d",
    "Stäubli": r"st(ä|ae|a)ubli|(?<![a-z])(tx2?|rx) ?-?\d",
    "Franka Emika": r"franka|panda|(?<![a-z])fr3",
    "Kinova": r"kinova|(?<![a-z])(gen3|jaco|j2[ns])",
    "UFACTORY": r"ufactory|xarm",
    "Doosan": r"doosan",
    "DENSO": r"denso",
    "Epson": r"epson",
    "Unitree": r"unitree|(?<![a-z])z1",
    "Unimation": r"unimation|puma",
}


def maker_of(name: str) -> str:
    """The maker of an arm of this name; empty where the name does not say."""
    plain = re.sub(r"[\W_]+", " ", name.lower())
    return next((maker for maker, pattern in MAKERS.items() if re.search(pattern, plain)), "")
