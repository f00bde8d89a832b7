"""RAPID: ``MoveAbsJ`` to joint targets in degrees.

A ``jointtarget`` is ``[robax, extax]``: six robot axes and six external ones, in degrees or mm, 9E9 for one that is not
there. ``VelSet`` scales all programmed speeds; ``fine`` stops at the point; ``WaitTime \\InPos`` waits until the arm
is at rest.
Source: ABB, "Technical reference manual, RAPID Instructions, Functions and Data types".
"""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.errors import InputError, Issue
from posture_opt.export.program_format import ProgramFormat, seconds
from posture_opt.export.robot_program import RobotProgram

_MAX_NAME_LENGTH = 32  # characters of a name in RAPID
_ABSENT_AXIS = "9E9"
_WORDS = """
    ALIAS AND BACKWARD CASE CONNECT CONST DEFAULT DIV DO ELSE ELSEIF ENDFOR ENDFUNC ENDIF ENDMODULE ENDPROC
    ENDRECORD ENDTEST ENDTRAP ENDWHILE ERROR EXIT FALSE FOR FROM FUNC GOTO IF INOUT LOCAL MOD MODULE NOSTEPIN NOT
    NOVIEW OR PERS PROC RAISE READONLY RECORD RETRY RETURN STEP SYSMODULE TASK TEST THEN TO TRAP TRUE TRYNEXT UNDO
    VAR VIEWONLY WHILE WITH XOR BOOL DNUM JOINTTARGET NUM STRING FINE TOOL0 WOBJ0 V1000 MOVEABSJ VELSET WAITTIME
"""
"""Key words, then built-in types and what this program uses of the controller."""


class Rapid(ProgramFormat):
    """A program module of an ABB controller: ``MoveAbsJ`` to joint targets [deg, mm] with ``fine`` stops."""

    summary: ClassVar[str] = "program module of an ABB controller (MoveAbsJ, degrees)"

    comment_mark: ClassVar[str] = "!"
    reserved: ClassVar[frozenset[str]] = frozenset(_WORDS.split())
    case_counts: ClassVar[bool] = False

    kind: Literal["rapid"] = "rapid"

    def files(self, program: RobotProgram) -> dict[str, str]:
        """``NAME.mod`` with the procedure ``NAME_run``.

        Raises:
            InputError: a name of more than 28 characters.
        """
        name = self.stem
        if len(name) > _MAX_NAME_LENGTH - 4:
            raise InputError(Issue(f"RAPID has names of at most {_MAX_NAME_LENGTH} characters", ("--name",), name))
        data, moves = [], [f"    VelSet {program.speed:g}, 5000;"]
        for k, (values, label) in enumerate(zip(program.degrees, program.labels, strict=True), start=1):
            robot = [*values, *["0"] * 6][: max(6, min(len(values), 6))]
            external = [*values[6:], *[_ABSENT_AXIS] * 6][:6]
            target = f"[[{', '.join(robot)}], [{', '.join(external)}]]"
            data.append(f"  CONST jointtarget {name}_p{k} := {target};")
            moves += [f"    {line}" for line in self.comments(label)]
            moves.append(f"    MoveAbsJ {name}_p{k}\\NoEOffs, v1000, fine, tool0;")
            moves += [f"    WaitTime\\InPos, {seconds(program.wait)};"] if program.wait else []
        head = [f"  {line}" for line in self.comments(*program.head)]
        lines = [f"MODULE {name}", *head, *data, f"  PROC {name}_run()", *moves, "  ENDPROC", "ENDMODULE", ""]
        return {f"{name}.mod": "\n".join(lines)}
