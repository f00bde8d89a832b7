"""How far a posture is from postures that were measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array, Json, Mask
from posture_opt.robot.robot import Robot

_TURN = 2 * math.pi


@dataclass(frozen=True)
class PostureDistance:
    """Distance of a posture from measured ones.

    Args:
        nearest: least over the measured postures of the largest difference of a joint [rad], slides left out where
            other joints turn; else [m].
        joint: the one that is farthest outside the range that it was measured in, by ``beyond`` [rad or m]; empty
            where all are within.
    """

    nearest: float
    joint: str
    beyond: float

    @classmethod
    def of(cls, robot: Robot, q: Array, measured: Array) -> PostureDistance:
        """Of posture q (n,) from the rows of ``measured`` (N, n) [rad or m]; whole turns count as none."""
        turns = np.array([joint.type == "revolute" for joint in robot.joints])
        apart = np.abs(_wrapped(measured - q, turns))
        near = apart[:, turns] if turns.any() else apart
        beyond = np.array(
            [_beyond(value, column, turn) for value, column, turn in zip(q, measured.T, turns, strict=True)]
        )
        worst = int(np.argmax(np.where(turns, beyond, beyond / _scale(measured, turns))))
        name = robot.joint_names[worst] if beyond[worst] > 0 else ""
        return cls(float(near.max(axis=1).min()), name, float(beyond[worst]))

    def to_json(self) -> dict[str, Json]:
        """Plain numbers [rad or m]."""
        return {"nearest": self.nearest, "joint": self.joint or None, "beyond": self.beyond}


def _wrapped(difference: Array, turns: Mask) -> Array:
    turned = (difference + math.pi) % _TURN - math.pi
    return np.where(turns, turned, difference)


def _beyond(value: float, column: Array, turns: bool) -> float:
    """How far a joint value lies outside of the range of measured ones, whole turns taken off."""
    low, high = float(column.min()), float(column.max())
    shifts = _TURN * np.arange(-2, 3) if turns else np.zeros(1)
    return float(np.min(np.maximum(0.0, np.maximum(low - value - shifts, value + shifts - high))))


def _scale(measured: Array, turns: Mask) -> Array:
    """(n,) metres of a slide that weigh as a radian: its measured range."""
    return np.where(turns, 1.0, np.maximum(np.ptp(measured, axis=0), 1e-3))
