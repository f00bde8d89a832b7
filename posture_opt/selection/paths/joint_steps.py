"""``JointSteps``: how far the joints move from one posture to the next, and what a step of joints counts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from posture_opt.numerics import TURN, Array, Codes, Mask
from posture_opt.robot.robot import Robot
from posture_opt.selection.program.nlp import Nlp

_LIMIT_TOLERANCE_RAD = 1e-9  # rad: limits a whole turn apart


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
    def of(cls, robot: Robot, nlp: Nlp) -> JointSteps:
        """Those of a robot whose postures ``nlp`` selects."""
        # A slide whose row in the program is its height alone is settled by it, and moves.
        held = [row for row in nlp.rows if ca.is_equal(row.lower, row.upper, 2)]
        settled = {
            k for row in held for k, used in enumerate(ca.which_depends(row.expression, nlp.x, 1, False)) if used
        }
        counted = np.array([k not in nlp.indifferent or k in settled for k in range(robot.n)])
        span = np.array(robot.upper) - np.array(robot.lower)
        turns = np.array([joint.type == "revolute" for joint in robot.joints])
        alike = np.array([k not in nlp.unlike_turns for k in range(robot.n)])
        return cls(robot, counted, turns & alike & (span >= TURN - _LIMIT_TOLERANCE_RAD))

    def rested(self, Q: Array) -> Array:
        """The same postures (N, n), joints that matter to nothing in the middle of their limits."""
        return np.where(self.counted, Q, (np.array(self.robot.lower) + np.array(self.robot.upper)) / 2)

    @property
    def span(self) -> Array:
        """(n,) from limit to limit [rad or m]: how far a joint can move at all."""
        return np.asarray(np.array(self.robot.upper) - np.array(self.robot.lower))

    def between(self, A: Array, B: Array, weights: Array | None = None) -> Array:
        """(N, M) the largest change of a joint, times its weight, from each posture of A (N, n) to each of B (M, n).

        Of joints that turn more than once, the least over whole turns.

        Args:
            weights: (n,) of the joints; default: one.
        """
        largest = np.zeros((len(A), len(B)))
        factors = np.ones(len(self.counted)) if weights is None else weights
        for k in np.flatnonzero(self.counted & (factors > 0)):
            difference = B[None, :, k] - A[:, None, k]
            if self.wide[k]:
                difference -= TURN * np.rint(difference / TURN)
            np.maximum(largest, factors[k] * np.abs(difference), out=largest)
        return largest

    def wrapped(self, Q: Array) -> Array:
        """The same postures (N, n), wide joints by whole turns as near to the middle of their limits as can be."""
        middle = (np.array(self.robot.lower) + np.array(self.robot.upper)) / 2
        return np.where(self.wide, Q - TURN * np.rint((Q - middle) / TURN), Q)

    def unwrapped(self, Q: Array) -> tuple[Array, Codes]:
        """The same motion (K, n) without jumps by whole turns, and the joints that leave their limits by it."""
        lower, upper = np.array(self.robot.lower), np.array(self.robot.upper)
        jumps = np.diff(Q, axis=0)
        turns = np.where(self.wide, np.rint(jumps / TURN), 0.0)
        Q = Q - TURN * np.vstack([np.zeros((1, Q.shape[1])), np.cumsum(turns, axis=0)])
        # All of a joint's values by the whole turns that bring their middle nearest to that of the limits.
        off = (Q.min(axis=0) + Q.max(axis=0) - lower - upper) / 2
        Q = np.where(self.wide, Q - TURN * np.rint(off / TURN), Q)
        beyond = np.any((lower - _LIMIT_TOLERANCE_RAD > Q) | (upper + _LIMIT_TOLERANCE_RAD < Q), axis=0)
        return np.clip(Q, lower, upper) if not np.any(beyond) else Q, np.flatnonzero(beyond)

    def along(self, Q: Array) -> Array:
        """(K − 1,) the largest change of a joint that counts between neighbours of a motion (K, n), without taking off
        turns.
        """
        moved = np.abs(np.diff(Q, axis=0))[:, self.counted]
        return np.asarray(np.max(moved, axis=1, initial=0.0))

    def swept(self, Q: Array, listed: Mask) -> Array:
        """(L − 1,) the largest range that a joint that counts sweeps on a motion (K, n) from one of the L listed points
        to the next, those between them included; at most the range between its limits.
        """
        ends = np.flatnonzero(listed)
        counted = Q[:, self.counted]
        if not counted.shape[1]:
            return np.zeros(len(ends) - 1)
        high = np.maximum(np.maximum.reduceat(counted, ends[:-1]), counted[ends[1:]])
        low = np.minimum(np.minimum.reduceat(counted, ends[:-1]), counted[ends[1:]])
        return np.asarray(np.max(high - low, axis=1))

    def whole_turns(self, Q: Array) -> Codes:
        """(n,) by how many whole turns each joint ends a motion (K, n) away from where it began; the nearest number."""
        turns = np.array([joint.type == "revolute" for joint in self.robot.joints])
        return np.where(turns & self.counted, np.rint((Q[-1] - Q[0]) / TURN), 0.0).astype(int)

    def without_turns(self, joints: Mask | Codes) -> JointSteps:
        """The same steps, some joints (of n, or their numbers) compared as they are and not but for whole turns."""
        none = np.zeros(len(self.wide), dtype=bool)
        none[joints] = True
        return replace(self, wide=self.wide & ~none)

    def turned(self, Q: Array, values: Array) -> tuple[Array, Array]:
        """Postures (M, n) with those that stand whole turns beside them within the limits, and their values (M,)."""
        lower, upper = np.array(self.robot.lower), np.array(self.robot.upper)
        for k, joint in enumerate(self.robot.joints):
            if joint.type != "revolute" or self.wide[k] or upper[k] - lower[k] < TURN - _LIMIT_TOLERANCE_RAD:
                continue
            rows, kept = [Q], [values]
            for turn in (-TURN, TURN):
                moved = Q + turn * np.eye(len(lower))[k]
                inside = (moved[:, k] >= lower[k]) & (moved[:, k] <= upper[k])
                rows.append(moved[inside])
                kept.append(values[inside])
            Q, values = np.vstack(rows), np.concatenate(kept)
        return Q, values
