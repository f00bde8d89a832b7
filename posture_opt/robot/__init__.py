"""The nominal serial chain in numbers, read from one of several formats.

A format is one frozen ``Spec`` in a file of its own, listed in ``FORMATS``; ``build(folder)`` makes the ``Robot``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.files import preset_names
from posture_opt.robot.dh import DhRobot, MdhRobot
from posture_opt.robot.flange import FlangeRobot
from posture_opt.robot.format import FrameSpec, JointSpec, RobotFormat
from posture_opt.robot.preset import PresetRobot, load_preset, preset_text
from posture_opt.robot.robot import Capsule, Factor, Joint, Repeatability, Robot, frame_factors
from posture_opt.robot.urdf import UrdfRobot
from posture_opt.spec import one_of

# Every format of the robot: section; the key kind selects one
FORMATS: tuple[type[RobotFormat], ...] = (DhRobot, MdhRobot, UrdfRobot, PresetRobot, FlangeRobot)

if TYPE_CHECKING:
    RobotSpec = RobotFormat
else:
    RobotSpec = one_of(FORMATS)

__all__ = [
    "FORMATS",
    "Capsule",
    "DhRobot",
    "Factor",
    "FlangeRobot",
    "FrameSpec",
    "Joint",
    "JointSpec",
    "MdhRobot",
    "PresetRobot",
    "Repeatability",
    "Robot",
    "RobotFormat",
    "RobotSpec",
    "UrdfRobot",
    "frame_factors",
    "load_preset",
    "preset_names",
    "preset_text",
]
