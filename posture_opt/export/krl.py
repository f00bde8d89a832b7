"""KUKA Robot Language: ``PTP`` and ``LIN`` to axis values in degrees.

A program is a ``.src`` file with the motions and a ``.dat`` file of the same name with its data. ``E6AXIS`` holds six
robot axes A1 … A6 and six external ones E1 … E6, in degrees or mm. ``LIN`` takes a pose, which ``FORWARD`` makes of
axis values with the tool and base that are set: ``$TOOL`` in mm and degrees, A about Z, B about Y, C about X;
``$LOAD`` in kg, its centre in the flange.
``$VEL.CP`` in m/s; ``C_DIS`` rounds a corner within ``$APO.CDIS`` [mm].
Source: KUKA, "KUKA System Software 8.x, Operating and Programming Instructions for System Integrators".
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.export.program_format import ProgramFormat, axes_of, seconds
from posture_opt.export.robot_program import RobotProgram
from posture_opt.numerics import Array
from posture_opt.robot.robot import xyz_rpy
from posture_opt.units import fixed

# Key words, built-in types and the programs that this one calls.
_WORDS = """
    ANIN ANOUT AND AXIS B_AND B_EXOR B_NOT B_OR BAS BOOL BRAKE C_DIS C_ORI C_PTP C_SPL C_VEL CASE CAST_FROM
    CAST_TO CCLOSE CHANNEL CHAR CIOCTL CIRC CIRC_REL CONFIRM CONST CONTINUE COPEN CREAD CWRITE DECL DEF DEFAULT
    DEFDAT DEFFCT DELAY DIGIN DISTANCE DO E6AXIS E6POS ELSE END ENDDAT ENDFCT ENDFOR ENDIF ENDLOOP ENDSPLINE
    ENDSWITCH ENDWHILE ENUM EXIT EXOR EXT EXTFCT FALSE FOR FRAME GLOBAL GOTO HALT IF IMPORT INT INTERRUPT IS LIN
    LIN_REL LOOP MAXIMUM MINIMUM NOT OFF ON OR PATH POS PRIO PTP PTP_REL PUBLIC PULSE REAL REL REPEAT RESUME
    RETURN SCIRC SEC SIGNAL SLIN SPL SPLINE SPTP STRUC SWITCH SWRITE SREAD THEN TIME_BLOCK TO TRIGGER TRUE UNTIL
    VAR WAIT WHEN WHILE WITH XOR FORWARD FAULT XL
"""


class Krl(ProgramFormat):
    """A program of a KUKA controller: ``PTP`` to axis values [deg, mm], exact stops, speed in percent."""

    summary: ClassVar[str] = "program of a KUKA controller (PTP, LIN, degrees): .src and .dat"
    maker: ClassVar[str] = "KUKA"

    comment_mark: ClassVar[str] = ";"
    reserved: ClassVar[frozenset[str]] = frozenset(_WORDS.split())
    case_counts: ClassVar[bool] = False

    kind: Literal["krl"] = "krl"

    def files(self, program: RobotProgram) -> dict[str, str]:
        """``NAME.src`` and ``NAME.dat``."""
        name = self.stem
        if len(name) > 24:
            raise InputError(Issue("KRL has names of at most 24 characters", ("--name",), name))
        head = self.comments(*program.head)
        data = ["&ACCESS RVP", f"DEFDAT {name}", *head]
        lines = ["DECL E6POS XL", "DECL INT FAULT"] if program.has_lines else []
        moves = ["&ACCESS RVP", f"DEF {name}()", *head, *lines, "BAS(#INITMOV, 0)"]
        moves += [f"BAS(#VEL_PTP, {program.speed:g})", f"BAS(#ACC_PTP, {program.speed:g})"]
        if program.has_lines:
            centre = np.eye(4)
            centre[:3, 3] = program.tool[:3, 3]
            load = f"$LOAD={{M {program.payload:g},CM {_frame(centre)},J {{X 0,Y 0,Z 0}}}}"
            moves += [load] if program.payload else []
            moves += [f"$TOOL={_frame(program.tool)}", "$BASE=$NULLFRAME", f"$VEL.CP={fixed(program.line_speed, 6)}"]
        stops = zip(program.degrees, program.labels, program.moves, strict=True)
        own, external = axes_of(program.robot)
        speed = program.line_speed
        for k, (values, label, move) in enumerate(stops, start=1):
            robot = [*(values[j] for j in own), *["0"] * (6 - len(own))]
            axes = [f"A{i} {value}" for i, value in enumerate(robot, start=1)]
            axes += [f"E{i} {values[j]}" for i, j in enumerate(external, start=1)]
            data.append(f"DECL E6AXIS XP{k}={{{', '.join(axes)}}}")
            moves += self.comments(label)
            waits = bool(move.waits and program.wait)
            if move.line and (wanted := program.speed_of(move)) != speed:
                moves.append(f"$VEL.CP={fixed(wanted, 6)}")
                speed = wanted
            if move.line:
                moves += [f"XL=FORWARD(XP{k}, FAULT)", "IF FAULT <> 0 THEN", "  HALT", "ENDIF"]
                rounded = bool(move.blend and not waits)
                moves += [f"$APO.CDIS={move.blend * 1e3:g}", "LIN XL C_DIS"] if rounded else ["LIN XL"]
            else:
                moves.append(f"PTP XP{k}")
            moves += [f"WAIT SEC {seconds(program.wait)}"] if waits else []
        return {f"{name}.src": "\n".join([*moves, "END", ""]), f"{name}.dat": "\n".join([*data, "ENDDAT", ""])}


def _frame(T: Array) -> str:
    """A pose (4, 4) [m] as KRL has it, in mm and degrees."""
    xyz, (roll, pitch, yaw) = xyz_rpy(T)
    values = (*(1e3 * v for v in xyz), *map(math.degrees, (yaw, pitch, roll)))
    entries = zip(("X", "Y", "Z", "A", "B", "C"), values, strict=True)
    return f"{{{', '.join(f'{axis} {fixed(value, 6)}' for axis, value in entries)}}}"
