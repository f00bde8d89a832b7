"""What a compensation has to say: the error before and after, and the rows to check before they run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.collision.scene_statements import scene_statements
from posture_opt.compensation.arrival_sides import sided_joints
from posture_opt.numerics import rms
from posture_opt.selection.answer.arm_statements import beyond_measured, free_frames
from posture_opt.statements import Quantity, Statement, state
from posture_opt.statements.notation import listed_lines

if TYPE_CHECKING:
    from posture_opt.compensation.compensation import Compensation

JUMP_RAD = math.radians(60.0)  # of a joint from one row to the next: more is worth a look before the program runs
_LARGE_CHANGE_RAD = math.radians(5.0)  # of a joint by compensation: as near a singular posture
_LENGTH_ROUNDING_M = 1e-9
_UNCERTAIN_SHARE = 0.8  # of what was off: as much left is no gain


def compensation_statements(found: Compensation) -> tuple[Statement, ...]:
    """All of them, the answer first."""
    off, left = rms(found.off), rms(found.left)
    first = state("compensation.nothing-known", left=Quantity(left))
    if off >= _LENGTH_ROUNDING_M:
        first = state("compensation.compensated", targets=len(found), left=Quantity(left), off=Quantity(off))
    uncertain = off >= _LENGTH_ROUNDING_M and left > _UNCERTAIN_SHARE * off
    return (
        first,
        *scene_statements(found.problem.scene, found.q),
        *beyond_measured(found.problem.arm, found.q),
        *([state("compensation.uncertain")] if uncertain else []),
        *_large_change(found),
        *found.cautions,
        *free_frames(found.problem.robot),
        state("compensation.columns"),
        state("compensation.joint-convention"),
    )


def cautions(found: Compensation) -> tuple[Statement, ...]:
    """Rows between which the arm changes its configuration, and sides of arrival that are uncertain or contradicted."""
    return (*_jumps(found), *_uncertain_sides(found), *_other_sides(found))


def _large_change(found: Compensation) -> list[Statement]:
    """Where a joint changes by much."""
    turns = np.array([joint.type == "revolute" for joint in found.problem.robot.joints])
    change = np.where(turns, np.abs(found.q - found.near), 0.0)
    row, joint = np.unravel_index(int(np.argmax(change)), change.shape)
    if found.targets.near is None or change[row, joint] < _LARGE_CHANGE_RAD:
        return []
    name, angle = found.problem.robot.joint_names[joint], Quantity(float(change[row, joint]), "joint angle")
    return [state("compensation.large-change", name, line=int(found.targets.line[row]), change=angle)]


def _jumps(found: Compensation) -> list[Statement]:
    """Where the arm changes its configuration, with the joint that moves most."""
    if found.targets.near is not None:
        return []
    return [
        state(
            "compensation.configuration-change",
            one.joint,
            moved=Quantity(one.moved, "joint angle"),
            first=one.first,
            last=one.last,
        )
        for one in found.changes
    ]


def _uncertain_sides(found: Compensation) -> list[Statement]:
    """Joints that hardly move, of which rounding decides from which side they arrive."""
    joints = tuple(found.problem.robot.joint_names[j] for j in np.flatnonzero(found.unsettled.any(axis=0)))
    lines = listed_lines(found.targets.line[found.unsettled.any(axis=1)].tolist())
    return [state("compensation.side-uncertain", joints[0], joints=joints, lines=lines)] if joints else []


def _other_sides(found: Compensation) -> list[Statement]:
    """Lines that state another side of arrival than the way from the row before them has."""
    moved, stated = np.sign(np.diff(found.q, axis=0)), found.targets.side[1:]
    other = np.any(sided_joints(found.problem.arm) & (stated != 0) & (moved != stated), axis=1)
    lines = found.targets.line[1:][other].tolist()
    return [state("compensation.side-contradicted", lines=listed_lines(lines))] if lines else []
