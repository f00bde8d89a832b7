"""Robots in the standard Denavit-Hartenberg convention."""

from __future__ import annotations

from typing import Literal

from posture_opt.robot.format import JointSpec, TableRobot
from posture_opt.robot.robot import Factor


class DhRobot(TableRobot):
    """``T_{i-1,i} = Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)``, ``theta`` or ``d`` carrying the joint variable.

    ``beta`` is nominally zero; it is the parameter that a pair of nearly parallel axes needs, where ``d`` jumps.
    Sources: Denavit, Hartenberg (1955); Hayati, Mirmirani (1985) for ``beta``.
    """

    kind: Literal["dh"] = "dh"

    @staticmethod
    def row(joint: JointSpec, index: int) -> tuple[Factor, ...]:
        """The five factors of one row of the table, in the order of their product. joint: ``a``, ``d`` [m], ``alpha``,
        ``theta`` [rad] of the row."""
        return (
            joint.driven(index, "theta"),
            joint.driven(index, "d"),
            Factor("translate", 0, joint.a, f"{joint.name}.a"),
            Factor("rotate", 0, joint.alpha, f"{joint.name}.alpha"),
            Factor("rotate", 1, 0.0, f"{joint.name}.beta"),
        )
