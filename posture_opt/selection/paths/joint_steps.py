"""``JointSteps``: how far the joints move from one posture to the next, and what a step of joints counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array, Codes, Mask
from posture_opt.robot.robot import Robot

_TURN = 2 * np.pi
_ROOM = 1e-9  # rad: limits a whole turn apart


@dataclass(frozen=True)
class JointSteps:
    """The steps of a robot's joints; those that matter to nothing count for nothing.

    A step is the largest change of any joint, a radian of a turning joint and a metre of a slide alike.

    Args:
        counted: (n,) joints whose steps count.
        wide: (n,) joints with a whole turn or more between their limits, compared but for whole turns.
    """

    robot: Robot
    counted: Mask
    wide: Mask

    @classmethod
    def of(cls, robot: Robot, indifferent: Sequence[int], bounded: Sequence[int] = ()) -> JointSteps:
        """Those of a robot; ``bounded`` joints are compared as they are, whatever their limits."""
        counted = np.array([k not in indifferent for k in range(robot.n)])
        span = np.array(robot.upper) - np.array(robot.lower)
        turns = np.array([joint.type == "revolute" for joint in robot.joints])
        free = np.array([k not in bounded for k in range(robot.n)])
        return cls(robot, counted, turns & free & (span >= _TURN - _ROOM))

    def between(self, A: Array, B: Array) -> Array:
        """(N, M) steps from each posture of A (N, n) to each of B (M, n)."""
        largest = np.zeros((len(A), len(B)))
        for k in np.flatnonzero(self.counted):
            difference = B[None, :, k] - A[:, None, k]
            if self.wide[k]:
                difference -= _TURN * np.rint(difference / _TURN)
            np.maximum(largest, np.abs(difference), out=largest)
        return largest

    def wrapped(self, Q: Array) -> Array:
        """The same postures (N, n), wide joints by whole turns as near to the middle of their limits as can be."""
        middle = (np.array(self.robot.lower) + np.array(self.robot.upper)) / 2
        return np.where(self.wide, Q - _TURN * np.rint((Q - middle) / _TURN), Q)

    def unwrapped(self, Q: Array) -> tuple[Array, Codes]:
        """The same motion (K, n) without jumps by whole turns, and the joints that leave their limits by it."""
        lower, upper = np.array(self.robot.lower), np.array(self.robot.upper)
        jumps = np.diff(Q, axis=0)
        turns = np.where(self.wide, np.rint(jumps / _TURN), 0.0)
        Q = Q - _TURN * np.vstack([np.zeros((1, Q.shape[1])), np.cumsum(turns, axis=0)])
        # All of a joint's values by the whole turns that bring their middle nearest to that of the limits.
        off = (Q.min(axis=0) + Q.max(axis=0) - lower - upper) / 2
        Q = np.where(self.wide, Q - _TURN * np.rint(off / _TURN), Q)
        beyond = np.any((lower - _ROOM > Q) | (upper + _ROOM < Q), axis=0)
        return np.clip(Q, lower, upper) if not np.any(beyond) else Q, np.flatnonzero(beyond)

    def along(self, Q: Array) -> Array:
        """(K − 1,) steps of a motion (K, n), as it is."""
        moved = np.abs(np.diff(Q, axis=0))[:, self.counted]
        return np.asarray(np.max(moved, axis=1, initial=0.0))

    def turned(self, Q: Array) -> Array:
        """Postures (M, n) with those that stand whole turns beside them within the limits."""
        lower, upper = np.array(self.robot.lower), np.array(self.robot.upper)
        joints = [k for k, joint in enumerate(self.robot.joints) if joint.type == "revolute" and not self.wide[k]]
        for k in joints:
            if upper[k] - lower[k] < _TURN - _ROOM:
                continue
            variants = [Q]
            for turn in (-_TURN, _TURN):
                moved = Q.copy()
                moved[:, k] += turn
                variants.append(moved[(moved[:, k] >= lower[k]) & (moved[:, k] <= upper[k])])
            Q = np.vstack(variants)
        return Q
