"""Robots read from a URDF file: the chain between two links, everything fixed folded in."""

from __future__ import annotations

import itertools
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from pydantic import Field

from posture_opt.robot.format import RobotFormat
from posture_opt.robot.robot import Robot

if TYPE_CHECKING:
    from posture_opt.robot.urdf_chain import UrdfChain
    from posture_opt.robot.urdf_tree import ChosenTip


class UrdfRobot(RobotFormat):
    """The chain from ``base_link`` to ``tip_link`` of a URDF file.

    Where they are not given, the base is the root and the tip the last link that carries no finger of a gripper: the
    only one, or ``tool0``, ROS-Industrial's name of the tool flange, or the only one named after a tool. Fingers are
    joints named so, two alike on one link, joints that mimic them, and a short slide behind the arm.

    A joint is ``Trans(x, y, z) Rz(yaw) Ry(pitch) Rx(roll)`` of its origin, then the motion about or along its axis;
    where the axis points against a coordinate axis, ``JOINT.theta`` is still positive along the stated axis. Errors
    ``JOINT.x|y|z|yaw|pitch`` are those of the origin's numbers. ``JOINT.roll`` is a turn about x in front of the pitch;
    without pitch it is the error of the number roll. So the three turn about perpendicular axes at every pitch, ±90°
    included. Fixed joints are constant; masses and shapes of the links fixed to a moving link are added to it.

    Source: ROS, "URDF XML specification", elements link and joint.
    """

    kind: Literal["urdf"] = "urdf"
    file: str = Field(description="the URDF, from the folder of the problem file")
    base_link: str | None = Field(None, description="where the chain begins; by default at the root")
    tip_link: str | None = Field(None, description="where it ends; by default at its only end, or before a gripper")
    srdf: str | None = Field(
        None, description="MoveIt's SRDF of the robot: pairs of links that are not checked, names of postures"
    )

    def nominal(self, folder: Path) -> Robot:
        """The chain in numbers."""
        return self._chain(folder).robot(self)

    def chosen_tip(self, folder: Path) -> ChosenTip:
        """The last link of the chain; where the section does not name it, with what was assumed."""
        return self._chain(folder).tip

    def _chain(self, folder: Path) -> UrdfChain:
        # Other formats of robots do without the reader of URDF.
        read = import_module("posture_opt.robot.urdf_chain").UrdfChain
        return cast("UrdfChain", read(folder, self.file, self.base_link, self.tip_link, self.srdf))


def pitched_rolls(robot: Robot) -> tuple[str, ...]:
    """Names of the roll parameters that come in front of a pitch, see `UrdfRobot`."""
    pairs = [pair for link in robot.links for pair in itertools.pairwise(link)]
    return tuple(a.parameter for a, b in pairs if a.parameter.endswith(".roll") and b.parameter.endswith(".pitch"))
