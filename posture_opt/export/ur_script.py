"""URScript: ``movej`` and ``movel`` to joint values in radians.

Source: Universal Robots, "The URScript Programming Language", module motion: ``movej(q, a, v, t, r)``, joint positions
as lists of six numbers in rad, ``a`` in rad/s², ``v`` in rad/s; ``movel(pose, a, v, t, r)`` in m/s² and m/s with the
corner radius r in m, whose pose may be joint positions, of which the controller takes the forward kinematics;
``set_tcp(pose)`` with a rotation vector; ``set_payload(m, cog)`` in kg and m; ``sleep(t)`` in s.
"""

from __future__ import annotations

from typing import ClassVar, Literal

from scipy.spatial.transform import Rotation

from posture_opt.errors import InputError, Issue
from posture_opt.export.program_format import ProgramFormat, seconds
from posture_opt.export.robot_program import RobotProgram
from posture_opt.units import fixed

_SPEED, _ACCELERATION = 1.05, 1.4  # rad/s, rad/s²: the defaults of movej
# Key words, then functions of the controller that a program of their name would replace.
_WORDS = """
    and break case continue def default elif else end enter_critical exit_critical False for global halt if in is
    join kill local mod not or pass return run sec struct switch thread True while xor movej movel movep movec
    servoj sleep textmsg popup sync
"""


class UrScript(ProgramFormat):
    """A program of a Universal Robots controller: ``movej`` to joint values [rad] at a share of its default speed,
    ``movel`` along paths, ``set_tcp`` in front of them.
    """

    summary: ClassVar[str] = "program of a Universal Robots controller (movej, movel, radians)"
    maker: ClassVar[str] = "Universal Robots"
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
        if program.has_lines:  # p[x, y, z, rx, ry, rz], in m and a rotation vector in rad
            frame = (*program.tool[:3, 3], *Rotation.from_matrix(program.tool[:3, :3]).as_rotvec())
            lines.append(f"  set_tcp(p[{', '.join(fixed(float(v), 9) for v in frame)}])")
        centre = ", ".join(fixed(float(v), 6) for v in program.tool[:3, 3])
        lines += [f"  set_payload({program.payload:g}, [{centre}])"] if program.payload else []
        turning = f"a={_ACCELERATION * share:.4g}, v={_SPEED * share:.4g}"
        for values, label, move in zip(program.si, program.labels, program.moves, strict=True):
            lines += [f"  {line}" for line in self.comments(label)]
            joints_text, waits = ", ".join(values), move.waits and program.wait
            corner = f", r={move.blend:g}" if move.blend and not waits else ""
            lines += [
                f"  movel([{joints_text}], a=1.2, v={program.speed_of(move):.4g}{corner})"
                if move.line
                else f"  movej([{joints_text}], {turning})"
            ]
            lines += [f"  sleep({seconds(program.wait)})"] if waits else []
        return {f"{self.stem}.script": "\n".join([*lines, "end", ""])}
