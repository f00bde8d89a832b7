"""``Abscissa``: what the figure of an effect is plotted against, in the units of its axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.model.arm_state import ArmState
from posture_opt.model.chain import Scalar
from posture_opt.numerics import Array


@dataclass(frozen=True, eq=False)
class Abscissa:
    """Values (N,) of one axis.

    Args:
        label: quantity and unit.
        side: (N,) side of approach −1 or +1 where the effect is one curve for each, 0 where no one knows it.
    """

    values: Array
    label: str
    side: Array

    @classmethod
    def of(cls, state: ArmState, values: Scalar, label: str, side: Scalar = 1.0) -> Abscissa:
        """An axis of values that are the same in all rows, or one a row."""
        n = len(np.atleast_1d(np.asarray(state.q[0])))
        return cls(_rows(values, n), label, _rows(side, n))


def _rows(values: Any, n: int) -> Array:
    return np.broadcast_to(np.asarray(values, dtype=float), (n,))


def over_joint(state: ArmState, joint: int, note: str = "", side: Scalar = 1.0) -> Abscissa:
    """The value of a joint."""
    of = state.robot.joints[joint]
    factor, unit = (math.degrees(1.0), "deg") if of.type == "revolute" else (1e3, "mm")
    return Abscissa.of(state, factor * np.asarray(state.q[joint]), f"{of.name} [{unit}]{note}", side)


def over_phase(state: ArmState, joint: int, cycles: float) -> Abscissa:
    """The phase of an error of so many cycles per revolution of a joint."""
    phase = np.degrees(np.mod(cycles * np.asarray(state.q[joint]), 2 * np.pi))
    return Abscissa.of(state, phase, f"phase of the cycle [deg], {cycles:.4g} cycles per revolution")


def over_time(state: ArmState, timed: bool) -> Abscissa:
    """The time of each row; its number where no times are logged."""
    time = np.asarray(state.inputs.time, dtype=float)
    return (
        Abscissa.of(state, time / 60, "time [min]")
        if timed
        else Abscissa.of(state, time + 1.0, "row, in the order of measuring")
    )
