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


class UrScript(ProgramFormat):
    """A program of a Universal Robots controller: ``movej`` to joint values [rad] at a share of its default speed."""

    summary: ClassVar[str] = "program of a Universal Robots controller (movej, radians)"
    most_joints: ClassVar[int] = 6

    kind: Literal["urscript"] = "urscript"

    def files(self, program: RobotProgram) -> dict[str, str]:
        joints = program.robot.joints
        if len(joints) != 6 or any(joint.type != "revolute" for joint in joints):
            message = f"URScript moves six turning joints, and this arm has {len(joints)} joints"
            raise InputError(Issue(message, ("--to",), self.kind, "use --to jointstate"))
        share = program.speed / 100
        lines = [*(f"# {line}" for line in program.head), f"def {self.stem}():"]
        for values, label in zip(program.si, program.labels, strict=True):
            lines += [f"  # {label}"] if label else []
            lines += [f"  movej([{', '.join(values)}], a={_ACCELERATION * share:.4g}, v={_SPEED * share:.4g})"]
            lines += [f"  sleep({seconds(program.wait)})"] if program.wait else []
        return {f"{self.stem}.script": "\n".join([*lines, "end", ""])}
