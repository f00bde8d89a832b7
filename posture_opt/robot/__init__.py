"""The nominal serial chain in numbers, read from one of several formats.

A format is one frozen ``Spec`` in a file of its own, listed in ``FORMATS``; ``build(folder)`` makes the ``Robot``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Union

from pydantic import Field

from posture_opt.robot.dh import DhRobot
from posture_opt.robot.format import FrameSpec, JointSpec, RobotFormat
from posture_opt.robot.mdh import MdhRobot
from posture_opt.robot.preset import PresetRobot, load_preset, preset_names, preset_text
from posture_opt.robot.robot import Factor, Joint, Repeatability, Robot, frame_factors
from posture_opt.robot.urdf import UrdfRobot

FORMATS: tuple[type[RobotFormat], ...] = (DhRobot, MdhRobot, UrdfRobot, PresetRobot)

if TYPE_CHECKING:
    RobotSpec = RobotFormat
else:
    RobotSpec = Annotated[Union[FORMATS], Field(discriminator="kind")]  # noqa: UP007 – of a tuple

__all__ = [
    "FORMATS",
    "DhRobot",
    "Factor",
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
