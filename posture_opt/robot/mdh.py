"""Robots in the modified Denavit-Hartenberg convention."""

from __future__ import annotations

from typing import Literal

from posture_opt.robot.format import JointSpec, TableRobot
from posture_opt.robot.robot import Factor


class MdhRobot(TableRobot):
    """``T_{i-1,i} = Rx(alpha) Tx(a) Rz(theta) Tz(d)``, ``theta`` or ``d`` carrying the joint variable.

    ``a`` and ``alpha`` of a row come before its joint: they are Craig's a_{i-1}, alpha_{i-1}.
    Source: Craig, Introduction to Robotics (2005), equation 3.6.
    """

    kind: Literal["mdh"] = "mdh"

    @staticmethod
    def row(joint: JointSpec, index: int) -> tuple[Factor, ...]:
        """The four factors of one row of the table, in the order of their product. joint: ``a``, ``d`` [m], ``alpha``,
        ``theta`` [rad] of the row."""
        return (
            Factor("rotate", 0, joint.alpha, f"{joint.name}.alpha"),
            Factor("translate", 0, joint.a, f"{joint.name}.a"),
            joint.driven(index, "theta"),
            joint.driven(index, "d"),
        )
