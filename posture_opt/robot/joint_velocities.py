"""``robot.velocity`` in the problem file: the largest speed of joints, by their names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from posture_opt.errors import BadValueError, InputError, Issue, did_you_mean
from posture_opt.robot.robot import Joint, Robot
from posture_opt.units import parse_quantity


def with_velocities(robot: Robot, given: Mapping[str, object]) -> Robot:
    """The same robot with other largest speeds of some joints.

    Args:
        robot: as its format describes it, speeds of data sheet or URDF included.
        given: joint name -> text with a unit, ``"120 deg/s"`` or, of a slide, ``"0.5 m/s"``.

    Raises:
        InputError: joints that the robot lacks, values without a unit or of the wrong one, or not above zero; keys
            relative to the robot's section.
    """
    if not given:
        return robot
    names = robot.joint_names
    issues = [
        Issue("the robot has no such joint", ("velocity", name), name, did_you_mean(name, names))
        for name in given
        if name not in names
    ]
    joints = tuple(
        _driven(joint, given[joint.name], issues) if joint.name in given else joint for joint in robot.joints
    )
    if issues:
        raise InputError(issues)
    return replace(robot, joints=joints)


def _driven(joint: Joint, given: object, issues: list[Issue]) -> Joint:
    """The joint with the speed that a text states; as it was, and an issue, where that is none."""
    try:
        speed = parse_quantity(given, "angular velocity" if joint.type == "revolute" else "velocity")
        if not speed > 0:
            raise BadValueError("the largest speed of a joint is above zero", "leave it out where it is unknown")
    except BadValueError as error:
        issues.append(error.issue(("velocity", joint.name), given))
        return joint
    return replace(joint, velocity=speed)
