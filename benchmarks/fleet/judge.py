"""One judge for all answers: what they violate, by a forward kinematics in plain NumPy, and their value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.fleet.brute import values
from benchmarks.fleet.requirements import Requirements
from posture_opt.numerics import Array
from tests.helpers.factors import pose

POSITION_TOLERANCE = 2e-6  # m: rows are met within 1e-6 each
AXIS_TOLERANCE = 5e-5  # rad: an arm with too few joints may be off by 2e-5 in each row
LIMIT_TOLERANCE = 1e-6  # rad or m


@dataclass(frozen=True)
class Judged:
    """What a posture violates [m, rad, rad or m], and its value (`criterion.exact`)."""

    position: float
    axis: float
    limits: float
    value: float

    @property
    def axis_met(self) -> bool:
        return self.axis <= AXIS_TOLERANCE

    @property
    def met(self) -> bool:
        """Whether everything that was asked for is met."""
        return self.position <= POSITION_TOLERANCE and self.limits <= LIMIT_TOLERANCE and self.axis_met


def judge(target: Requirements, q: Array) -> Judged:
    """Judge the posture (n,) for one target."""
    setup, (low, high) = target.case.setup, target.case.box
    T = pose(setup.model.robot, q)
    point = T[:3, 3]
    off = np.maximum(low - point, 0.0) + np.maximum(point - high, 0.0)
    a = T[:3, :3] @ np.array(setup.arm.tool_axis) / np.linalg.norm(setup.arm.tool_axis)
    d = np.array(target.case.direction)
    # atan2, since arccos loses half the digits near zero
    angle = float(np.arctan2(np.linalg.norm(np.cross(a, d)), a @ d))
    lower, upper = setup.limits
    return Judged(
        position=float(np.linalg.norm(off[target.moving])),
        axis=max(angle - setup.task.tilt, 0.0) if setup.aligned else 0.0,
        limits=float(max(np.max(lower - q), np.max(q - upper), 0.0)),
        value=float(values(target, np.asarray(q, dtype=float)[None])[0]),
    )
