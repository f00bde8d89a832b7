"""pybotics as its calibration example has it: `OptimizationHandler`, `optimize_accuracy` and SciPy's `least_squares`.

Modified DH, all parameters of the chain but those of the first link, which the world frame has; world frame and tool
point. The residuals of `optimize_accuracy` are lengths of errors, which have a kink at zero: SciPy creeps, and is
stopped (`pybotics_components` has the same arm with residuals along x, y and z). It states no uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pybotics.kinematic_chain import MDHKinematicChain
from pybotics.optimization import OptimizationHandler, optimize_accuracy
from pybotics.robot import Robot
from pybotics.tool import Tool
from scipy.optimize import least_squares

from benchmarks.calibrators import Answer, Array, Task, shift, turn

TITLE = "pybotics, as documented"
PACKAGES = ("pybotics",)
EVALUATIONS = 50  # of residuals with their derivatives; hundreds gain little

Residuals = Callable[[Array, OptimizationHandler, Array, Array], Array]


def robot(task: Task, learned: Array) -> Robot:
    """The arm in the modified convention, base and tool where the points are."""
    a, alpha, d, theta = task.table.T
    links = np.column_stack([[0.0, *alpha[:-1]], [0.0, *a[:-1]], theta, d])  # alpha, a, theta, d
    base, point = task.frames(learned)
    last = shift(a[-1], 0.0, 0.0) @ turn(0, alpha[-1:])[0]
    chain = MDHKinematicChain.from_parameters(links.ravel())
    return Robot(chain, Tool(shift(*(last @ [*point, 1.0])[:3])), base)


def adjust(task: Task, learned: Array, asked: Array, residuals: Residuals) -> Answer:
    """The arm that makes residuals small, asked for other rows."""
    n = len(task.table)
    chain = [False] * 4 + [True] * (4 * n - 4)
    handler = OptimizationHandler(robot(task, learned), chain, [True] * 3 + [False] * 3, [True] * 6)
    x0 = handler.generate_optimization_vector()
    given = (handler, task.q[learned], task.points[learned])
    result = least_squares(residuals, x0, args=given, x_scale="jac", max_nfev=EVALUATIONS)
    handler.apply_optimization_vector(result.x)
    points = np.array([handler.robot.fk(q)[:3, 3] for q in task.q[asked]])
    return Answer(points - task.points[asked], parameters=len(x0))


def fit(task: Task, learned: Array, asked: Array) -> Answer:
    return adjust(task, learned, asked, optimize_accuracy)
