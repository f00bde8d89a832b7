"""Postures: what a caller states, in radians or with units, and what results hold, printed in degrees."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from posture_opt.errors import BadValueError, InputError, Issue, did_you_mean
from posture_opt.numerics import TURN, Array
from posture_opt.robot.robot import Joint, Robot
from posture_opt.units import fixed, parse_quantity

# n joint values in the order of the robot, or joint name -> value: numbers in rad or m, or texts with a unit. One text
# has all of them: "90 deg, -180 deg".
PostureLike = Mapping[str, float | str] | Sequence[float | str] | str | Any
_AT_LIMIT = 1e-4  # Distance from a limit [rad or m] up to which a joint is at it


class Posture(dict[str, float]):
    """Joint name -> value [rad or m]; printed, it shows degrees and millimetres, and `degrees` has these numbers.
    robot: names and types of the joints; q: (n,) joint values [rad or m], from the base to the tool."""

    def __init__(self, robot: Robot, q: Sequence[float] | Any) -> None:
        super().__init__(zip(robot.joint_names, map(float, q), strict=True))
        self._slides: frozenset[str] = frozenset(joint.name for joint in robot.joints if joint.type == "prismatic")

    @property
    def degrees(self) -> dict[str, float]:
        """Joint name -> value [deg, of prismatic joints mm]."""
        return {name: q * 1e3 if name in self._slides else math.degrees(q) for name, q in self.items()}

    def __repr__(self) -> str:
        units = {name: (3, "mm") if name in self._slides else (4, "deg") for name in self}  # micrometres at the tool
        shown = [f"{name}: {fixed(value, units[name][0])} {units[name][1]}" for name, value in self.degrees.items()]
        return f"{{{', '.join(shown)}}}"


def read_posture(robot: Robot, posture: PostureLike) -> tuple[float, ...]:
    """The (n,) joint values [rad or m] of a posture given by order or by name."""
    values = _values_by_name(robot, posture) if isinstance(posture, Mapping) else _values_by_order(robot, posture)
    issues: list[Issue] = []
    read = [_read_value(joint, value, issues) for joint, value in zip(robot.joints, values, strict=True)]
    if issues:
        raise InputError(issues)
    return tuple(read)


def beyond_limits(robot: Robot, posture: Sequence[float]) -> tuple[tuple[Joint, float], ...]:
    """The joints outside their limits, with the excess [rad or m]: positive above the upper, negative below the lower.
    posture: (n,) joint values [rad or m]."""
    excess = [value - min(max(value, j.lower), j.upper) for j, value in zip(robot.joints, posture, strict=True)]
    # What is written in degrees comes back with the rounding of the conversion.
    return tuple((joint, off) for joint, off in zip(robot.joints, excess, strict=True) if abs(off) > 1e-9)


def joints_at_limits(robot: Robot, Q: Array) -> list[str]:
    """Joints at a limit in some postures Q (N, n) [rad or m], held ones left out: controllers seldom go so far."""
    Q = np.atleast_2d(Q)
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    near = np.any((Q - lower < _AT_LIMIT) | (upper - Q < _AT_LIMIT), axis=0) & (upper - lower > _AT_LIMIT)
    return [name for name, at in zip(robot.joint_names, near, strict=True) if at]


def _values_by_name(robot: Robot, posture: Mapping[str, Any]) -> list[Any]:
    """(n,) values as given, in the order of the robot."""
    names = robot.joint_names
    issues = [
        Issue("the robot has no such joint", ("posture", str(name)), given, did_you_mean(str(name), names))
        for name, given in posture.items()
        if name not in names
    ]
    missing = [name for name in names if name not in posture]
    if missing:
        issues.append(Issue(f"no value for {', '.join(missing)}", ("posture",), hint="give every joint a value"))
    if issues:
        raise InputError(issues)
    return [posture[name] for name in names]


def _values_by_order(robot: Robot, posture: Any) -> list[Any]:
    """(n,) values as given by a sequence or by one text with commas."""
    wanted = f"give {robot.n} values: {', '.join(robot.joint_names)} (rad, prismatic joints in m, or with units)"
    if isinstance(posture, str):
        posture = [part.strip() for part in posture.split(",")]
    if isinstance(posture, bytes) or not hasattr(posture, "__len__"):
        raise InputError(Issue(f"{posture!r} is no posture", ("posture",), posture, wanted))
    if len(posture) != robot.n:
        given = f"{len(posture)} {'value' if len(posture) == 1 else 'values'} given for {robot.n} joints"
        raise InputError(Issue(given, ("posture",), posture, wanted))
    return list(posture)


def _read_value(joint: Joint, value: object, issues: list[Issue]) -> float:
    """[rad or m]; zero with an issue."""
    key = ("posture", joint.name)
    if isinstance(value, str):
        try:
            return parse_quantity(value, "angle" if joint.type == "revolute" else "length")
        except BadValueError as error:
            issues.append(error.issue(key, value))
    elif isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
        issues.append(Issue(f"{value!r} is no number", key, value, f"give a value in {joint.unit}"))
    elif not math.isfinite(value):
        issues.append(Issue(f"the value is {value}", key, value, f"give a finite value in {joint.unit}"))
    else:
        return float(value)
    return 0.0


def drawn_between(robot: Robot, whole: Collection[int] = ()) -> tuple[Array, Array]:
    """(n,), (n,) bounds [rad or m] of random postures: the limits, or of wider turning joints, those of ``whole`` left
    out, one turn nearest to zero, as further turns repeat the places: ``low = min(max(−π, lower), upper − 2π)``."""
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    wide = np.array([joint.type == "revolute" for joint in robot.joints]) & (upper - lower > TURN)
    wide[list(whole)] = False
    low = np.where(wide, np.minimum(np.maximum(-np.pi, lower), upper - TURN), lower)
    return low, np.where(wide, low + TURN, upper)
