"""What leaves the program for other programs and for controllers: one frozen ``Spec`` a format, listed here.

A new format is one file and one line in ``EXPORTS``.
"""

from __future__ import annotations

from posture_opt.export.c_code import CCode
from posture_opt.export.dh_table import DhTable
from posture_opt.export.export_format import ExportFormat
from posture_opt.export.joint_state import JointState
from posture_opt.export.krl import Krl
from posture_opt.export.python_code import PythonCode
from posture_opt.export.rapid import Rapid
from posture_opt.export.urdf_arm import UrdfArm
from posture_opt.export.urscript import UrScript

EXPORTS: tuple[type[ExportFormat], ...] = (CCode, PythonCode, UrdfArm, DhTable, UrScript, Krl, Rapid, JointState)
