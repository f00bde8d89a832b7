"""SciPy SLSQP over Pinocchio's kinematics, the best of 16 random starts, every derivative analytic."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

from benchmarks.arms import Arm, Array
from benchmarks.objective import SCALE, worst_axis_gradient
from benchmarks.ways import Solve, random_starts

TITLE = "SciPy SLSQP + Pinocchio, 16 starts"

# SLSQP often ends at the optimum with "positive directional derivative": what counts is whether the rows are met.
VIOLATION = 1e-7
TINY = 1e-9


class Kinematics:
    """Tool point, tool axis and Jacobian at the posture last asked for: SLSQP asks four times at each."""

    def __init__(self, arm: Arm) -> None:
        self.model, self.data, self.tip = arm.model, arm.model.createData(), arm.tip_id
        self.q = np.full(arm.model.nq, np.nan)

    def at(self, q: Array) -> Kinematics:
        if not np.array_equal(q, self.q):
            self.q = q.copy()
            pin.computeJointJacobians(self.model, self.data, self.q)
            tip = pin.updateFramePlacement(self.model, self.data, self.tip)
            self.position, self.axis = tip.translation.copy(), tip.rotation[:, 2].copy()
            self.J = pin.getFrameJacobian(self.model, self.data, self.tip, pin.LOCAL_WORLD_ALIGNED)
        return self


def build(arm: Arm, starts: int = 16, seed: int = 0) -> Solve:
    kinematics, (lower, upper) = Kinematics(arm), arm.limits
    variances = np.square(arm.sigma) * SCALE

    def objective(q: Array) -> tuple[float, Array]:
        J = kinematics.at(q).J
        return worst_axis_gradient(J[:3], J[3:], variances)

    def solve(position: Array) -> Array | None:
        constraint = _pose_constraint(kinematics, position)
        outcomes = [
            minimize(
                objective,
                start,
                jac=True,
                method="SLSQP",
                bounds=list(zip(lower, upper, strict=True)),
                constraints=constraint,
                options={"ftol": 1e-8, "maxiter": 100},
            )
            for start in random_starts(arm, starts, seed)
        ]
        solved = [outcome for outcome in outcomes if np.abs(constraint["fun"](outcome.x)).max() < VIOLATION]
        return min(solved, key=lambda outcome: outcome.fun).x if solved else None

    return solve


def _pose_constraint(kinematics: Kinematics, position: Array) -> dict[str, Any]:
    """Tool point at the target, tool axis down: three lengths and the two horizontal parts of a rotation vector.

    The angle between tool axis and vertical goes along the horizontal part h of the axis a: (θ / sin θ) h = 0,
    θ = atan2(|h|, -a_z). Unlike h = 0 it tells down from up, and pulls as hard from everywhere: of the forms tried,
    this one succeeds from most starts.
    """

    def pose(q: Array) -> Array:
        k = kinematics.at(q)
        sine, theta = _tilt(k.axis)
        return np.concatenate([k.position - position, k.axis[:2] * (theta / sine if sine > TINY else 1.0)])

    def jacobian(q: Array) -> Array:
        k = kinematics.at(q)
        dh = _axis_jacobian(k)
        sine, theta = _tilt(k.axis)
        if sine <= TINY:
            return np.vstack([k.J[:3], dh[:2]])
        dsine = k.axis[:2] @ dh[:2] / sine
        dtheta = sine * dh[2] - k.axis[2] * dsine
        stretch = dtheta / sine - theta * dsine / sine**2
        return np.vstack([k.J[:3], dh[:2] * (theta / sine) + np.outer(k.axis[:2], stretch)])

    return {"type": "eq", "fun": pose, "jac": jacobian}


def _tilt(axis: Array) -> tuple[float, float]:
    """Sine and angle between a unit vector and straight down."""
    sine = math.hypot(axis[0], axis[1])
    return sine, math.atan2(sine, -axis[2])


def _axis_jacobian(k: Kinematics) -> Array:
    """∂a/∂q_j = z_j × a for a direction a fixed in the tool: (3, n)."""
    (ax, ay, az), (zx, zy, zz) = k.axis, k.J[3:]
    return np.array([zy * az - zz * ay, zz * ax - zx * az, zx * ay - zy * ax])
