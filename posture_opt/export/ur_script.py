"""URScript: ``movej`` to joint values in radians.

Source: Universal Robots, "The URScript Programming Language", module motion: ``movej(q, a, v, t, r)``, joint positions
as lists of six numbers in rad, ``a`` in rad/s², ``v`` in rad/s; ``sleep(t)`` in s.
"""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.errors import InputError, Issue
from posture_opt.export.program_format import ProgramFormat, seconds
from posture_opt.export.robot_program import RobotProgram

_SPEED, _ACCELERATION = 1.05, 1.4  # rad/s, rad/s²: the defaults of movej
_WORDS = """
    and break case continue def default elif else end enter_critical exit_critical False for global halt if in is
    join kill local mod not or pass return run sec struct switch thread True while xor movej movel movep movec
    servoj sleep textmsg popup sync
"""
"""Key words, then functions of the controller that a program of their name would replace."""


class UrScript(ProgramFormat):
    """A program of a Universal Robots controller: ``movej`` to joint values [rad] at a share of its default speed."""

    summary: ClassVar[str] = "program of a Universal Robots controller (movej, radians)"
    most_joints: ClassVar[int] = 6

    comment_mark: ClassVar[str] = "#"
    reserved: ClassVar[frozenset[str]] = frozenset(_WORDS.split())

    kind: Literal["urscript"] = "urscript"

    def files(self, program: RobotProgram) -> dict[str, str]:
        joints = program.robot.joints
        if len(joints) != 6 or any(joint.type != "revolute" for joint in joints):
            message = f"URScript moves six turning joints, and this arm has {len(joints)} joints"
            raise InputError(Issue(message, ("--to",), self.kind, "use --to jointstate"))
        share = program.speed / 100
        lines = [*self.comments(*program.head), f"def {self.stem}():"]
        for values, label in zip(program.si, program.labels, strict=True):
            lines += [f"  {line}" for line in self.comments(label)]
            lines += [f"  movej([{', '.join(values)}], a={_ACCELERATION * share:.4g}, v={_SPEED * share:.4g})"]
            lines += [f"  sleep({seconds(program.wait)})"] if program.wait else []
        return {f"{self.stem}.script": "\n".join([*lines, "end", ""])}
