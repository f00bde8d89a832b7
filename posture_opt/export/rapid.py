"""RAPID: ``MoveAbsJ`` and ``MoveL`` to joint targets in degrees.

A ``jointtarget`` is ``[robax, extax]``: six robot axes and six external ones, in degrees or mm, 9E9 for one that is not
there. ``VelSet`` scales all programmed speeds; ``fine`` stops at the point; ``WaitTime \\InPos`` waits until the arm
is at rest. ``MoveL`` takes a pose, which ``CalcRobT`` makes of a joint target for a tool. ``tooldata`` is ``[held,
[position, quaternion], [mass, centre, …]]`` in mm and kg, ``speeddata`` ``[mm/s, deg/s, mm/s, deg/s]``; z0 and z1 round
corners within 0.3 and 1 mm.
Source: ABB, "Technical reference manual, RAPID Instructions, Functions and Data types".
"""

from __future__ import annotations

from typing import ClassVar, Literal

from scipy.spatial.transform import Rotation

from posture_opt.errors import InputError, Issue
from posture_opt.export.program_format import ProgramFormat, axes_of, seconds
from posture_opt.export.robot_program import RobotProgram
from posture_opt.units import fixed

_ZONES = {1e-3: "z1", 0.3e-3: "z0"}  # radius [m] -> predefined zone
# Key words, then built-in types and what this program uses of the controller.
_WORDS = """
    ALIAS AND BACKWARD CASE CONNECT CONST DEFAULT DIV DO ELSE ELSEIF ENDFOR ENDFUNC ENDIF ENDMODULE ENDPROC
    ENDRECORD ENDTEST ENDTRAP ENDWHILE ERROR EXIT FALSE FOR FROM FUNC GOTO IF INOUT LOCAL MOD MODULE NOSTEPIN NOT
    NOVIEW OR PERS PROC RAISE READONLY RECORD RETRY RETURN STEP SYSMODULE TASK TEST THEN TO TRAP TRUE TRYNEXT UNDO
    VAR VIEWONLY WHILE WITH XOR BOOL DNUM JOINTTARGET NUM STRING FINE TOOL0 WOBJ0 V1000 MOVEABSJ MOVEL
    CALCROBT TOOLDATA SPEEDDATA VELSET WAITTIME
"""


class Rapid(ProgramFormat):
    """A program module of an ABB controller: ``MoveAbsJ`` to joint targets [deg, mm] with ``fine`` stops."""

    summary: ClassVar[str] = "program module of an ABB controller (MoveAbsJ, MoveL, degrees)"
    maker: ClassVar[str] = "ABB"

    comment_mark: ClassVar[str] = "!"
    reserved: ClassVar[frozenset[str]] = frozenset(_WORDS.split())
    case_counts: ClassVar[bool] = False

    kind: Literal["rapid"] = "rapid"

    def files(self, program: RobotProgram) -> dict[str, str]:
        """``NAME.mod`` with the procedure ``NAME_run``."""
        name = self.stem
        if len(name) > 32 - len("_run"):
            raise InputError(Issue("RAPID has names of at most 32 characters", ("--name",), name))
        data, moves = [], [f"    VelSet {program.speed:g}, 5000;"]
        tool, percent, speed_names = "tool0", program.speed, dict[float, str]()
        if program.has_lines:
            tool = f"{name}_tool"
            data += [f"  PERS tooldata {tool} := {_tooldata(program)};"]
            speeds = dict.fromkeys(program.speed_of(move) for move in program.moves if move.line)
            speed_names = {speed: f"{name}_v{k or ''}" for k, speed in enumerate(speeds)}
            data += [
                f"  CONST speeddata {name} := [{speed * 1e3:.6g}, 500, 5000, 1000];"
                for speed, name in speed_names.items()
            ]
        stops = zip(program.degrees, program.labels, program.moves, strict=True)
        own, external = axes_of(program.robot)
        for k, (values, label, move) in enumerate(stops, start=1):
            robot = [*(values[j] for j in own), *["0"] * (6 - len(own))]
            further = [*(values[j] for j in external), *["9E9"] * 6][:6]
            target = f"[[{', '.join(robot)}], [{', '.join(further)}]]"
            data.append(f"  CONST jointtarget {name}_p{k} := {target};")
            moves += [f"    {line}" for line in self.comments(label)]
            waits = bool(move.waits and program.wait)
            if (wanted := 100.0 if move.line else program.speed) != percent:  # of lines the speed is their own
                moves.append(f"    VelSet {wanted:g}, 5000;")
                percent = wanted
            zone = _ZONES.get(0.0 if waits else move.blend, "fine")
            moves.append(
                f"    MoveL CalcRobT({name}_p{k}, {tool}), {speed_names[program.speed_of(move)]}, {zone}, {tool};"
                if move.line
                else f"    MoveAbsJ {name}_p{k}\\NoEOffs, v1000, fine, {tool};"
            )
            moves += [f"    WaitTime\\InPos, {seconds(program.wait)};"] if waits else []
        moves += [] if percent == program.speed else [f"    VelSet {program.speed:g}, 5000;"]
        head = [f"  {line}" for line in self.comments(*program.head)]
        lines = [f"MODULE {name}", *head, *data, f"  PROC {name}_run()", *moves, "  ENDPROC", "ENDMODULE", ""]
        return {f"{name}.mod": "\n".join(lines)}


def _tooldata(program: RobotProgram) -> str:
    """The tool that the robot holds: position [mm], orientation as a quaternion, payload [kg] at the tool point."""
    T = program.tool
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True)
    at = ", ".join(fixed(float(1e3 * v), 6) for v in T[:3, 3])
    turn = ", ".join(fixed(float(v), 9) for v in (w, x, y, z))
    mass = max(program.payload, 0.1)  # tooldata without a mass is refused
    return f"[TRUE, [[{at}], [{turn}]], [{mass:g}, [{at}], [1, 0, 0, 0], 0, 0, 0]]"
