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
            message = f"the arm has {program.robot.n} joints, and a program of this kind moves {self.most_joints}"
            raise InputError(Issue(message, ("--to",), self.summary.split(":")[0], "use --to jointstate"))
        notes = []
        robot, maker = program.robot, maker_of(program.robot.name)
        if maker and self.maker and maker != self.maker:
            notes.append(f"The arm is a {robot.name}, and this is a program for controllers of {self.maker}.")
        if self.maker and (external := axes_of(robot)[1]):
            notes.append(f"External axes, in this order: {', '.join(robot.joint_names[j] for j in external)}.")
        if self.maker and program.has_lines:
            text = "The tool data is that of the model, in its flange frame: check that the controller's flange frame"
            notes.append(f"{text} is the same.")
        program = replace(program, notes=(*notes, *program.notes))
        return Exported(self.files(program), program.notes)

    @abstractmethod
    def files(self, program: RobotProgram) -> dict[str, str]:
        """File name -> text of a program, in the language of the controller."""

    def comments(self, *texts: str) -> list[str]:
        """A line of comment for each text that is not empty, in printable ASCII: nothing in it can end the line."""
        return [f"{self.comment_mark} {plain(text)}" for text in texts if text]


def axes_of(robot: Robot) -> tuple[list[int], list[int]]:
    """Which joints are the six axes of the robot in the languages of controllers, and which its external ones.

    A rail in front of six joints that turn is external, and so is what is behind the sixth axis.
    """
    every = list(range(robot.n))
    rail = next((k for k in every if robot.joints[k].type == "revolute"), 0)
    first = min(rail, max(robot.n - 6, 0))
    return every[first : first + 6], [*every[:first], *every[first + 6 :]]


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
