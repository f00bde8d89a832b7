"""Values that options state: scatter of the joints, a posture, a corner, a height."""

from __future__ import annotations

import re
from collections.abc import Iterable

from posture_opt.errors import BadValueError, InputError, Issue, did_you_mean
from posture_opt.robot.robot import Joint, Robot
from posture_opt.units import is_bare_zero, parse_quantity


def joint_sigmas(text: str, joints: tuple[Joint, ...]) -> dict[str, str]:
    """Parameter -> quantity of ``--sigma``: an angle is for all revolute joints, a length for all prismatic ones."""
    given: dict[str, str] = {}
    issues: list[Issue] = []
    for entry in entries(text):
        if is_bare_zero(entry):  # for joints of which nothing was said before
            kind = next((joint.type for joint in joints if joint.type not in given), "revolute")
        else:
            wrong: list[Issue] = []
            _checked(entry, "length", (), wrong)
            kind = "revolute" if wrong else "prismatic"
        try:
            _check(entry, kind, given, joints)
        except BadValueError as error:
            issues.append(error.issue(("--sigma",), entry))
        given[kind] = entry
    if issues:
        raise InputError(issues)
    return {_own_parameter(joint): given[joint.type] for joint in joints if joint.type in given}


def _check(entry: str, kind: str, given: dict[str, str], joints: tuple[Joint, ...]) -> None:
    if kind in given:
        what = "length" if kind == "prismatic" else "angle"
        hint = "give one for all joints, or each its own in a problem file"
        raise BadValueError(f"two {what}s, {given[kind]} and {entry}", hint)
    if parse_quantity(entry, "length" if kind == "prismatic" else "angle") < 0:
        raise BadValueError(f"the standard deviation {entry} is negative", f"write {entry.lstrip('- ')}")
    if not any(joint.type == kind for joint in joints):
        there = ("revolute", "an angle: 0.02 deg") if kind == "prismatic" else ("prismatic", "a length: 0.01 mm")
        message = f"{entry} is meant for {kind} joints, and this arm has none"
        raise BadValueError(message, f"all are {there[0]}, write {there[1]}")


def exact_note(joints: tuple[Joint, ...], sigma: dict[str, str]) -> tuple[str, ...]:
    """A note on joints that ``--sigma`` says nothing about: they are taken as exact."""
    exact = [joint for joint in joints if _own_parameter(joint) not in sigma]
    if not exact:
        return ()
    what, example = ("slide", "0.01 mm") if exact[0].type == "prismatic" else ("turning joint", "0.02 deg")
    names, many = ", ".join(joint.name for joint in exact), "s" * (len(exact) > 1)
    text = ", ".join([*dict.fromkeys(sigma.values()), example])
    return (f'--sigma says nothing of the {what}{many} {names}, taken as exact: else write --sigma "{text}"',)


def _own_parameter(joint: Joint) -> str:
    return f"{joint.name}.{'theta' if joint.type == 'revolute' else 'd'}"


def entries(text: str) -> list[str]:
    """The entries of ``"0.6 m, 0.2 m, 0.1 m"``; bare numbers may be separated by blanks."""
    text = text.strip().strip("[]()")
    if "," not in text and ";" not in text and re.fullmatch(r"[-+.\deE\s]+", text):
        return text.split()
    return [entry.strip() for entry in re.split(r"[,;]", text)]


def frame_of(option: str, text: str) -> str | dict[str, list[str]]:
    """The frame of ``"0, 0, 150 mm"`` or ``"0, 0, 150 mm, 0, 0, 90 deg"`` (x, y, z, roll, pitch, yaw), as in a file."""
    if text.strip() == "free":
        return "free"
    parts = entries(text)
    if len(parts) not in (3, 6):
        count = "1 entry" if len(parts) == 1 else f"{len(parts)} entries"
        hint = f'write x, y, z: {option} "0, 0, 150 mm", or add roll, pitch, yaw: "0, 0, 150 mm, 0, 0, 90 deg"'
        raise InputError(Issue(f"{count} where 3 or 6 belong", (option,), text, hint))
    issues: list[Issue] = []
    for index, part in enumerate(parts):
        axis = ("x", "y", "z", "roll", "pitch", "yaw")[index]
        _checked(part, "length" if index < 3 else "angle", (option, axis), issues)
    if issues:
        raise InputError(issues)
    return {"xyz": parts[:3], **({"rpy": parts[3:]} if parts[3:] else {})}


def columns_of(given: Iterable[str]) -> dict[str, str | int]:
    """Known column -> header, or number of the column, of ``--column "x=Pos X [mm]"``."""
    found: dict[str, str | int] = {}
    issues: list[Issue] = []
    for text in given:
        name, equals, head = (part.strip() for part in text.partition("="))
        if not (name and equals and head):
            issues.append(Issue("no NAME=HEAD", ("--column",), text, 'write for example --column "x=Pos X [mm]"'))
        elif name in found:
            issues.append(Issue(f"{name} is given twice", ("--column",), text, "keep one"))
        found[name] = int(head) if head.isdigit() else head
    if issues:
        raise InputError(issues)
    return found


def _checked(text: str, dimension: str, key: tuple[str, ...], issues: list[Issue]) -> float:
    """A quantity [SI]; what is wrong with it is added to ``issues``."""
    try:
        return parse_quantity(text, dimension)
    except BadValueError as error:
        issues.append(error.issue(key, text))
        return 0.0


def quantity_of(option: str, text: str, dimension: str = "length") -> float:
    """The quantity [SI] that an option states."""
    try:
        return parse_quantity(text, dimension)
    except BadValueError as error:
        raise InputError(error.issue((option,), text)) from None


def distance_of(option: str, text: str) -> float:
    """A length [m] that is not negative."""
    value = quantity_of(option, text)
    if value < 0:
        raise InputError(Issue("a distance is not negative", (option,), text, "write for example 50 mm"))
    return value


def requested_posture(text: str, robot: Robot) -> dict[str, float]:
    """Joint name -> value [rad or m] of ``"90 deg, -180 deg"`` or ``"joint1=90 deg, joint2=-180 deg"``."""
    pairs = [tuple(part.strip() for part in entry.split("=", 1)) for entry in entries(text) if entry]
    by_name = any(len(pair) == 2 for pair in pairs)
    issues: list[Issue] = []
    if not by_name and len(pairs) != robot.n:
        given = f"{len(pairs)} value{'s' * (len(pairs) != 1)} for {robot.n} joint{'s' * (robot.n != 1)}"
        hint = f"give one value each, in this order: {', '.join(robot.joint_names)}"
        raise InputError(Issue(given, ("--posture",), text, hint))
    named = pairs if by_name else [(name, *pair) for name, pair in zip(robot.joint_names, pairs, strict=True)]
    posture = {pair[0]: _joint_value(pair, robot, issues) for pair in named}
    missing = [name for name in robot.joint_names if name not in posture]
    if missing:
        hint = f"the joints are {', '.join(robot.joint_names)}"
        issues.append(Issue(f"no value for {', '.join(missing)}", ("--posture",), text, hint))
    if len(posture) != len(named):
        issues.append(Issue("a joint is named twice", ("--posture",), text))
    if issues:
        raise InputError(issues)
    return posture


def _joint_value(pair: tuple[str, ...], robot: Robot, issues: list[Issue]) -> float:
    """The value [rad or m] of one joint; what is wrong with it is added to ``issues``.

    Args:
        pair: (joint, value), or (joint,) where the value is missing.
    """
    key = ("--posture", pair[0])
    joint = next((joint for joint in robot.joints if joint.name == pair[0]), None)
    if joint is None:
        issues.append(Issue("the robot has no such joint", key, pair[0], did_you_mean(pair[0], robot.joint_names)))
        return 0.0
    if len(pair) == 1:
        issues.append(Issue("no value", key, None, f"write {pair[0]}=0 {'deg' if joint.type == 'revolute' else 'mm'}"))
        return 0.0
    return _checked(pair[1], "angle" if joint.type == "revolute" else "length", key, issues)


def corner(option: str, text: str | None, issues: list[Issue]) -> tuple[float, float, float] | None:
    """The corner (3,) of a box [m], world frame, that an option states; what is wrong is added to ``issues``."""
    if text is None:
        return None
    parts = entries(text)
    values = [_checked(part, "length", (option,), issues) for part in parts]
    if len(parts) != 3:
        what = f"a corner has three coordinates, {len(parts)} are given"
        issues.append(Issue(what, (option,), text, "0.3 m, 0.1 m, 0.2 m"))
        return None
    return values[0], values[1], values[2]
