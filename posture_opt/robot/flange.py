"""Poses of a flange without an arm: what a controller reports in place of joint values."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from pydantic import Field

from posture_opt.robot.format import FULL_TURN, FrameSpec, RobotFormat, ToolSpec
from posture_opt.robot.robot import Factor, Joint, Robot

PREFIX = "flange_"
REACH_M = 10.0  # either way from the controller's base: an arm on a track


class FlangeRobot(RobotFormat):
    """``T_base_flange = Trans(x, y, z) Rz(yaw) Ry(pitch) Rx(roll)``, measured and without errors of its own.

    Only frames are unknown: the tool, and the base in the frame of the instrument.
    """

    kind: Literal["flange"] = "flange"
    base: FrameSpec = Field(FrameSpec(free=True), description="base in the world; found from measurements")
    tool: ToolSpec = Field(ToolSpec(free=True), description="tool point in the flange; found from measurements")

    def nominal(self, folder: Path) -> Robot:
        """Three slides and three turns without named parameters; ``folder`` is not needed."""
        slides = [Joint(PREFIX + axis, "prismatic", -REACH_M, REACH_M) for axis in "xyz"]
        turns = [Joint(PREFIX + angle, "revolute", *FULL_TURN) for angle in ("yaw", "pitch", "roll")]
        links = [(Factor("translate", axis, joint=axis),) for axis in (0, 1, 2)]
        links += [(Factor("rotate", axis, joint=5 - axis),) for axis in (2, 1, 0)]
        return replace(self.assemble("flange", (*slides, *turns), tuple(links)), pose_prefix=PREFIX)
