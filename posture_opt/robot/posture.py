"""The posture that a caller names, checked against the joints of the robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from posture_opt.errors import InputError, Issue, did_you_mean
from posture_opt.robot.robot import Joint, Robot

PostureLike = Mapping[str, float] | Sequence[float] | Any
"""n joint values [rad or m] in the order of the robot, or joint name -> value."""


def read_posture(robot: Robot, posture: PostureLike) -> tuple[float, ...]:
    """The (n,) joint values [rad or m] of a posture given by order or by name.

    Raises:
        InputError: another number of values, unknown or missing joint names, values that are no finite numbers.
    """
    values = _by_name(robot, posture) if isinstance(posture, Mapping) else _by_order(robot, posture)
    issues = [issue for joint, value in zip(robot.joints, values, strict=True) for issue in _not_a_number(joint, value)]
    if issues:
        raise InputError(issues)
    return tuple(float(value) for value in values)


def limit_notes(robot: Robot, posture: Sequence[float]) -> tuple[str, ...]:
    """One sentence for each joint outside its limits."""
    notes = []
    for joint, value in zip(robot.joints, posture, strict=True):
        excess = max(value - joint.upper, joint.lower - value)
        # What is written in degrees comes back with the rounding of the conversion.
        if excess > 1e-9:
            side = "above its upper" if value > joint.upper else "below its lower"
            limit = joint.upper if value > joint.upper else joint.lower
            notes.append(f"{joint.name} is {_shown(joint, excess)} {side} limit of {_shown(joint, limit)}")
    return tuple(notes)


def _by_name(robot: Robot, posture: Mapping[str, Any]) -> list[Any]:
    names = robot.joint_names
    issues = []
    for name in posture:
        if name not in names:
            mend = did_you_mean(str(name), names)
            issues.append(Issue("the robot has no such joint", ("posture", str(name)), posture[name], mend))
    missing = [name for name in names if name not in posture]
    if missing:
        issues.append(Issue(f"no value for {', '.join(missing)}", ("posture",), mend="give every joint a value"))
    if issues:
        raise InputError(issues)
    return [posture[name] for name in names]


def _by_order(robot: Robot, posture: Any) -> list[Any]:
    wanted = f"give {robot.n} values: {', '.join(robot.joint_names)} (rad, prismatic joints in m)"
    if isinstance(posture, str | bytes) or not hasattr(posture, "__len__"):
        raise InputError(Issue(f"{posture!r} is no posture", ("posture",), posture, wanted))
    if len(posture) != robot.n:
        given = f"{len(posture)} {'value' if len(posture) == 1 else 'values'} given for {robot.n} joints"
        raise InputError(Issue(given, ("posture",), posture, wanted))
    return list(posture)


def _not_a_number(joint: Joint, value: Any) -> list[Issue]:
    key = ("posture", joint.name)
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
        return [Issue(f"{value!r} is no number", key, value, f"give a value in {joint.unit}")]
    if not math.isfinite(value):
        return [Issue(f"the value is {value}", key, value, f"give a finite value in {joint.unit}")]
    return []


def _shown(joint: Joint, value: float) -> str:
    return f"{math.degrees(value):.4g} deg" if joint.type == "revolute" else f"{value * 1e3:.4g} mm"
