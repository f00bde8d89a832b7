"""pybotics with residuals along x, y and z in place of its lengths: what one would write after a look at the first."""

from __future__ import annotations

import numpy as np
from pybotics.optimization import OptimizationHandler

from benchmarks.calibrators import Answer, Array, Task
from benchmarks.calibrators.pybotics_fit import PACKAGES as PACKAGES
from benchmarks.calibrators.pybotics_fit import adjust

TITLE = "pybotics, residuals along x, y, z"


def components(x: Array, handler: OptimizationHandler, q: Array, points: Array) -> Array:
    """(3 m,) model minus measured [m]."""
    handler.apply_optimization_vector(x)
    return np.array([handler.robot.fk(one)[:3, 3] for one in q]).ravel() - points.ravel()


def fit(task: Task, learned: Array, asked: Array) -> Answer:
    return adjust(task, learned, asked, components)
