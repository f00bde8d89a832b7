"""What is said where targets are refused: the line of each, what keeps the arm from it, and what all have in common."""

from __future__ import annotations

import math

import numpy as np

from posture_opt.compensation.compensation import Compensation
from posture_opt.model.reach_bound import stretched
from posture_opt.units import number

_LIMIT_TOLERANCE = 1e-9  # rad or m
_OTHER_UNIT_LENGTHS = 3.0  # times the length of the arm: a target beyond is probably in another unit
_MAX_LISTED_LINES = 20  # lines named in an error


def refusal_text(found: Compensation) -> str:
    """The message of an error: a line for each target that is refused with its reason, and a hint for all of them."""
    bad = np.flatnonzero(~found.reached)
    places = [
        f"{found.targets.file}:{found.targets.line[k]}: {found.reasons.get(int(k)) or unreached_reason(found, int(k))}"
        for k in bad[:_MAX_LISTED_LINES]
    ]
    more = [f"and {len(bad) - _MAX_LISTED_LINES} more"] if len(bad) > _MAX_LISTED_LINES else []
    head = f"{len(bad)} of {len(found)} targets cannot be reached"
    return "\n".join([head, *places, *more, *_common_hint(found), *_other_posture_hint(found)])


def unreached_reason(found: Compensation, k: int) -> str:
    """Why target k is not reached: distance or angle that is left, and the joints at their limits."""
    robot = found.problem.robot
    held = [
        f"{joint.name} at its {'upper' if value > (joint.lower + joint.upper) / 2 else 'lower'} limit"
        for joint, value in zip(robot.joints, found.q[k], strict=True)
        if min(value - joint.lower, joint.upper - value) < max(_LIMIT_TOLERANCE, found.digits.turn)
    ]
    because = f" ({', '.join(held)})" if held else ""
    off, turned = found.after.off[k], found.after.turned[k]
    if off > 10 * found.digits.turn * robot.length + 1e-6:
        return f"the tool point stays {number(1e3 * off)} mm away{because}"
    return f"the tool comes there only turned by {number(math.degrees(turned))} deg{because}"


def _other_posture_hint(found: Compensation) -> tuple[str, ...]:
    """A hint where the joint values of the file lead to what is refused, and other ones may not."""
    targets = found.targets
    if targets.near is None or targets.position is None or not found.reasons:
        return ()
    return (
        "postures stay near the joint values of the file: without these columns others are found, if there are any",
    )


def _common_hint(found: Compensation) -> tuple[str, ...]:
    """A hint where every target is farther off than the arm is long: another unit, or another frame."""
    first, longest = stretched(found.problem.robot)
    away = np.linalg.norm(found.wanted.position - first, axis=1)
    if not (away > longest).all():
        return ()
    if float(away.min()) > _OTHER_UNIT_LENGTHS * longest:
        return (f"the arm stretches to {longest * 1e3:.0f} mm: is the unit of x, y, z right?",)
    origin = ", ".join(f"{1e3 * float(x):.0f}" for x in first)
    return (
        f"the arm stretches to {longest * 1e3:.0f} mm from its first joint, at ({origin}) mm in the world frame of the "
        'problem file: if the targets are in the frame of the robot, add --base "0, 0, 0"',
    )
