"""KUKA Robot Language: ``PTP`` to axis values in degrees.

A program is a ``.src`` file with the motions and a ``.dat`` file of the same name with its data. ``E6AXIS`` holds six
robot axes A1 … A6 and six external ones E1 … E6, in degrees or mm.
Source: KUKA, "KUKA System Software 8.x, Operating and Programming Instructions for System Integrators".
"""

from __future__ import annotations

from typing import ClassVar, Literal

from posture_opt.errors import InputError, Issue
from posture_opt.export.program_format import ProgramFormat, seconds
from posture_opt.export.robot_program import RobotProgram

_AXES = (*(f"A{k}" for k in range(1, 7)), *(f"E{k}" for k in range(1, 7)))
_MAX_NAME_LENGTH = 24  # characters of a name in KRL
_WORDS = """
    ANIN ANOUT AND AXIS B_AND B_EXOR B_NOT B_OR BAS BOOL BRAKE C_DIS C_ORI C_PTP C_SPL C_VEL CASE CAST_FROM
    CAST_TO CCLOSE CHANNEL CHAR CIOCTL CIRC CIRC_REL CONFIRM CONST CONTINUE COPEN CREAD CWRITE DECL DEF DEFAULT
    DEFDAT DEFFCT DELAY DIGIN DISTANCE DO E6AXIS E6POS ELSE END ENDDAT ENDFCT ENDFOR ENDIF ENDLOOP ENDSPLINE
    ENDSWITCH ENDWHILE ENUM EXIT EXOR EXT EXTFCT FALSE FOR FRAME GLOBAL GOTO HALT IF IMPORT INT INTERRUPT IS LIN
    LIN_REL LOOP MAXIMUM MINIMUM NOT OFF ON OR PATH POS PRIO PTP PTP_REL PUBLIC PULSE REAL REL REPEAT RESUME
    RETURN SCIRC SEC SIGNAL SLIN SPL SPLINE SPTP STRUC SWITCH SWRITE SREAD THEN TIME_BLOCK TO TRIGGER TRUE UNTIL
    VAR WAIT WHEN WHILE WITH XOR
"""
"""Key words, built-in types and the programs that this one calls."""


class Krl(ProgramFormat):
    """A program of a KUKA controller: ``PTP`` to axis values [deg, mm], exact stops, speed and acceleration in
    percent.
    """

    summary: ClassVar[str] = "program of a KUKA controller (PTP, degrees): .src and .dat"

    comment_mark: ClassVar[str] = ";"
    reserved: ClassVar[frozenset[str]] = frozenset(_WORDS.split())
    case_counts: ClassVar[bool] = False

    kind: Literal["krl"] = "krl"

    def files(self, program: RobotProgram) -> dict[str, str]:
        """``NAME.src`` and ``NAME.dat``.

        Raises:
            InputError: a name of more than 24 characters.
        """
        name = self.stem
        if len(name) > _MAX_NAME_LENGTH:
            raise InputError(Issue(f"KRL has names of at most {_MAX_NAME_LENGTH} characters", ("--name",), name))
        head = self.comments(*program.head)
        data = ["&ACCESS RVP", f"DEFDAT {name}", *head]
        moves = ["&ACCESS RVP", f"DEF {name}()", *head, "BAS(#INITMOV, 0)"]
        moves += [f"BAS(#VEL_PTP, {program.speed:g})", f"BAS(#ACC_PTP, {program.speed:g})"]
        for k, (values, label) in enumerate(zip(program.degrees, program.labels, strict=True), start=1):
            axes = zip(_AXES, [*values, *["0"] * (6 - len(values))], strict=False)
            data.append(f"DECL E6AXIS XP{k}={{{', '.join(f'{axis} {value}' for axis, value in axes)}}}")
            moves += self.comments(label)
            moves.append(f"PTP XP{k}")
            moves += [f"WAIT SEC {seconds(program.wait)}"] if program.wait else []
        return {f"{name}.src": "\n".join([*moves, "END", ""]), f"{name}.dat": "\n".join([*data, "ENDDAT", ""])}
