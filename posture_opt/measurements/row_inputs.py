"""The inputs of effects in every row, and whether the rows were read from a moving arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import SAME_POSTURE_RAD
from posture_opt.model.arm import Arm
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE, Inputs
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot

STOP_S = 1.0
"""An arm does not stop, settle and get measured within a second: faster rows of other postures are of a moving arm."""
_GAP = 5.0
"""Of the usual time from row to row, from which on another path begins."""


def moves(data: Measurements) -> bool:
    """Whether most rows of the file were read while the arm moved: their times say so."""
    if data.time is None or len(data) < 3 or np.ptp(data.time) <= 0:
        return False
    order = data.order
    step = np.abs(np.diff(data.q[order], axis=0)).max(axis=1)
    return bool(np.mean((step > SAME_POSTURE_RAD) & (np.diff(data.time[order]) < STOP_S)) > 0.5)


def joint_speeds(data: Measurements) -> Array:
    """(N, n) speed of the joints [rad/s or m/s] by central differences along each path.

    Times that were rounded are those of evenly spaced rows, where these fit them to a row.
    """
    assert data.time is not None, "the time of the rows is known"
    order, speeds = data.order, np.zeros(data.q.shape)
    for rows in _paths(data.time[order], order):
        if len(rows) > 2:
            speeds[rows] = np.gradient(data.q[rows], _even_times(data.time[rows]), axis=0)
    return speeds


def _paths(time: Array, order: Codes) -> list[Codes]:
    """The rows of each path in their order: between two of them no row was read for long."""
    steps = np.diff(time)
    return list(np.split(order, np.flatnonzero(steps > _GAP * max(float(np.mean(steps)), 1e-12)) + 1))


def _even_times(time: Array) -> Array:
    """(N,) increasing times [s]: evenly spaced ones, where rounding explains how the logged ones differ from them."""
    rows = np.arange(len(time))
    even = np.polyval(np.polyfit(rows, time, 1), rows)
    if float(np.abs(even - time).max()) <= 1.5 * float(np.diff(np.unique(time)).min(initial=np.inf)):
        return np.asarray(even, dtype=float)
    least = 1e-3 * float(np.ptp(time)) / len(time)
    return np.asarray(np.maximum.accumulate(time) + least * rows)


def inputs_of(data: Measurements, robot: Robot) -> Inputs:
    """The inputs of effects in every row: temperature above the reference [K], time since the first row [s] or row
    number.
    """
    n = len(data)
    return Inputs(
        speed=list(joint_speeds(data).T) if moves(data) else (),
        payload=data.payload if data.payload is not None else np.full(n, robot.payload),
        approach=list(data.approach.T),
        approach_length=list(data.approach_length.T),
        temperature=data.temperature - REFERENCE_TEMPERATURE if data.temperature is not None else np.zeros(n),
        time=data.time - data.time.min() if data.time is not None else np.arange(n, dtype=float),
    )


def arm_for(arm: Arm, data: Measurements) -> Arm:
    """The arm under the inputs of every row; all sides of approach count as stated."""
    return arm.under(replace(inputs_of(data, arm.robot), stated=data.joint_names))
