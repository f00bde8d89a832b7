"""``--sigma``: one scatter for all joints that turn, one for all that slide."""

from __future__ import annotations

import re

from posture_opt.errors import BadValueError, InputError, Issue
from posture_opt.robot.robot import Joint
from posture_opt.units import parse_quantity


def joint_sigmas(text: str, joints: tuple[Joint, ...]) -> dict[str, str]:
    """Parameter -> quantity: an angle is meant for all revolute joints, a length for all prismatic ones."""
    given: dict[str, str] = {}
    issues: list[Issue] = []
    for entry in entries(text):
        kind = "prismatic" if _is_length(entry) else "revolute"
        try:
            _check(entry, kind, given, joints)
        except BadValueError as error:
            issues.append(error.issue(("--sigma",), entry))
        given[kind] = entry
    if issues:
        raise InputError(issues)
    return {_own_parameter(joint): given[joint.type] for joint in joints if joint.type in given}


def _check(entry: str, kind: str, given: dict[str, str], joints: tuple[Joint, ...]) -> None:
    """Refuse an entry of ``--sigma`` that repeats a former one, is no σ, or is meant for joints that the arm lacks."""
    if kind in given:
        what = "length" if kind == "prismatic" else "angle"
        mend = "give one for all joints, or each its own in a problem file"
        raise BadValueError(f"two {what}s, {given[kind]} and {entry}", mend)
    if parse_quantity(entry, "length" if kind == "prismatic" else "angle") < 0:
        raise BadValueError(f"the standard deviation {entry} is negative", f"write {entry.lstrip('- ')}")
    if not any(joint.type == kind for joint in joints):
        there = ("revolute", "an angle: 0.02 deg") if kind == "prismatic" else ("prismatic", "a length: 0.01 mm")
        message = f"{entry} is meant for {kind} joints, and this arm has none"
        raise BadValueError(message, f"all are {there[0]}, write {there[1]}")


def exact_note(joints: tuple[Joint, ...], sigma: dict[str, str]) -> tuple[str, ...]:
    """What to tell of joints that ``--sigma`` says nothing about."""
    exact = [joint for joint in joints if _own_parameter(joint) not in sigma]
    if not exact:
        return ()
    what, example = ("slide", "0.01 mm") if exact[0].type == "prismatic" else ("turning joint", "0.02 deg")
    names, many = ", ".join(joint.name for joint in exact), "s" * (len(exact) > 1)
    text = ", ".join([*dict.fromkeys(sigma.values()), example])
    return (f'--sigma says nothing of the {what}{many} {names}, taken as exact: else write --sigma "{text}"',)


def _own_parameter(joint: Joint) -> str:
    """The parameter that adds to the joint's own variable."""
    return f"{joint.name}.{'theta' if joint.type == 'revolute' else 'd'}"


def _is_length(text: str) -> bool:
    try:
        parse_quantity(text, "length")
    except ValueError:
        return False
    return True


def entries(text: str) -> list[str]:
    """The entries of ``"0.6 m, 0.2 m, 0.1 m"``; bare numbers may stand with blanks between them."""
    text = text.strip().strip("[]()")
    if "," not in text and ";" not in text and re.fullmatch(r"[-+.\deE\s]+", text):
        return text.split()
    return [entry.strip() for entry in re.split(r"[,;]", text)]
