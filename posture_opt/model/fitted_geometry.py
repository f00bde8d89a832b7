"""Which parameters of a chain measurements can tell apart: not those that do what another one does."""

from __future__ import annotations

import math

from posture_opt.robot.robot import Robot

PARALLEL_AXES_RAD = math.radians(10.0)  # below, `d` and `a` can no longer follow a tilt of the next axis (Hayati 1983)


def is_fitted(robot: Robot, name: str) -> bool:
    """Whether a parameter ``JOINT.LAST`` of the geometry is a candidate: not where another one does the same.

    ``beta`` is one only between nearly parallel axes (Hayati, Mirmirani 1985); a joint with an origin of six has no
    offset of its own.
    """
    joint, _, last = name.rpartition(".")
    parameters = robot.parameters
    index = robot.joint_names.index(joint) if joint in robot.joint_names else -1
    if last == "beta":
        alpha = parameters[f"{joint}.alpha"].nominal
        return index < robot.n - 1 and abs(math.sin(alpha)) < math.sin(PARALLEL_AXES_RAD)
    # The joint value of a URDF joint moves the tool as its origin does.
    return not (last in ("theta", "d") and f"{joint}.roll" in parameters)


def geometry_behind_first_joint(robot: Robot) -> tuple[str, ...]:
    """The candidates that do not move the whole arm as its base does: those behind the value of the first joint."""
    found = []
    for factor in robot.factors[robot.driven[0] + 1 :]:
        name = factor.parameter
        if name and name.rpartition(".")[0] != "tool" and is_fitted(robot, name):
            found.append(name)
    return tuple(found)
