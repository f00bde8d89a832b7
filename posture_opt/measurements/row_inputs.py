"""The inputs of effects, row by row of measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posture_opt.measurements.measurements import Measurements
from posture_opt.model.arm import Arm
from posture_opt.model.arm_state import REFERENCE_TEMPERATURE, Inputs
from posture_opt.robot.robot import Robot


def inputs_of(data: Measurements, robot: Robot) -> Inputs:
    """The inputs of effects in every row of measurements."""
    n = len(data)
    return Inputs(
        payload=data.payload if data.payload is not None else np.full(n, robot.payload),
        approach=list(data.approach.T),
        approach_length=list(data.approach_length.T),
        temperature=data.temperature - REFERENCE_TEMPERATURE if data.temperature is not None else np.zeros(n),
        time=data.time - data.time.min() if data.time is not None else np.arange(n, dtype=float),
    )


def arm_for(arm: Arm, data: Measurements) -> Arm:
    """The arm under the inputs of every row."""
    return arm.under(replace(inputs_of(data, arm.robot), stated=data.joint_names))
