"""From which side, and after how long a move, the joints arrive at each row; the inputs of effects that follow.

Backlash and hysteresis depend on the direction of the last move of a joint, hysteresis also on its length. In a list
of commands both follow from the row before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.compensation.targets import Targets
from posture_opt.model.arm import Arm
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE, Inputs
from posture_opt.numerics import Array, Mask

_MOVE_TOLERANCE = 1e-12  # rad or m: a smaller step is rounding
_LONG_MOVE = 1e6  # rad or m: the move to the first row, of which nothing is known but that it was long


@dataclass(frozen=True, eq=False)
class Arrivals:
    """How the joints arrive at N rows.

    Args:
        side: (N, n) direction of the last move of each joint: +1 when its value grew, −1 when it fell, 0 where unknown.
        way: (N, n) length of that move [rad or m].
    """

    side: Array
    way: Array

    @property
    def known(self) -> Mask:
        """(N, n) whether the side is known."""
        return np.asarray(self.side != 0)

    def inputs(self, arm: Arm, rows: Targets, stated: Sequence[str] = ()) -> Inputs:
        """The inputs of effects in every row: its own columns, and those of the task where it has none.

        Args:
            arm: whose own inputs (payload, temperature, time) are taken where a column is missing.
            stated: names of joints whose side counts as known; the others' side is a source of error.
        """
        given, n = arm.inputs, len(rows)
        warmth = None if rows.temperature is None else rows.temperature - REFERENCE_TEMPERATURE
        return Inputs(
            payload=np.full(n, given.payload) if rows.payload is None else rows.payload,
            approach=list(self.side.T),
            approach_length=list(self.way.T),
            temperature=np.full(n, given.temperature) if warmth is None else warmth,
            time=np.full(n, given.time) if rows.time is None else rows.time,
            stated=tuple(stated),
        )


def arrivals_of(arm: Arm, rows: Targets, q: Array) -> Arrivals:
    """The arrivals at commands (N, n) [rad or m] that follow each other.

    ``side_k = sign(q_k − q_{k−1})``; where a joint does not move, the last move before it counts. The first row has no
    move before it: the joints come from far, so that hysteresis is complete (`_LONG_MOVE`).

    The file's ``approach`` columns count; else the sign of the last move, which a joint that does not move keeps; at
    the first row what the task states.
    """
    step = np.diff(q, axis=0, prepend=q[:1])
    last = np.where(np.abs(step) > _MOVE_TOLERANCE, np.arange(len(q))[:, None], 0)
    move = np.take_along_axis(step, np.maximum.accumulate(last, axis=0), axis=0)
    task = [arm.inputs.side(j) if joint.name in arm.inputs.stated else 0.0 for j, joint in enumerate(arm.robot.joints)]
    side = np.where(move != 0, np.sign(move), np.array(task, dtype=float))
    return Arrivals(np.where(rows.side != 0, rows.side, side), np.where(move != 0, np.abs(move), _LONG_MOVE))


def sided_joints(arm: Arm) -> Mask:
    """Joints (n,) that have an effect which depends on the side of arrival."""
    asked = {effect.target for effect in arm.effects if "approach" in effect.needs}
    return np.array([joint.name in asked for joint in arm.robot.joints])
