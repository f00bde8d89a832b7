"""Joints beyond the data of their effects, and frames that are not known yet."""

from __future__ import annotations

import numpy as np

from posture_opt.model.arm import Arm
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot
from posture_opt.statements import Quantity, Statement, state


def beyond_measured(arm: Arm, Q: Array) -> tuple[Statement, ...]:
    """Each effect that some of the postures Q (N, n) [rad or m] leave the measured range of, each that has one."""
    found = []
    for one in arm.beyond_measured(Q):
        values = np.atleast_2d(Q)[:, one.joint]
        worst = float(values[int(np.argmax(np.maximum(one.low - values, values - one.high)))])
        angles = {"value": worst, "low": one.low, "high": one.high, "size": one.effect.unmeasured_size}
        given = {name: Quantity(angle, "joint angle") for name, angle in angles.items()}
        found.append(state("selection.beyond-measured", one.effect.target, effect=one.effect.title, **given))
    return (*found, *known_ranges(arm))


def known_ranges(arm: Arm) -> tuple[Statement, ...]:
    """The effects that are known only between two values of their joint."""
    return tuple(
        state("selection.known-range", one.effect.target, effect=one.effect.title,
              low=Quantity(one.low, "joint angle"), high=Quantity(one.high, "joint angle"))
        for one in arm.measured_ranges
    )  # fmt: skip


def free_frames(robot: Robot) -> tuple[Statement, ...]:
    """What became of a base or tool that the problem file leaves free."""
    free = {"base": robot.base_free, "tool": robot.tool_free}
    return tuple(state("problem.frame-free", frame) for frame, is_free in free.items() if is_free)
