"""A joint that is logged relative to another: the coupling J2-J3 of parallelogram arms and some controllers."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.measurements.affine_fit import affine_fit, sample_rows, touch_misfit
from posture_opt.measurements.measurements import Measurements, carried_joint_values
from posture_opt.model.arm import Arm
from posture_opt.model.effects import JointCoupling
from posture_opt.numerics import Array

_POOR_MISFIT = 0.03  # unexplained share of the motion from which a coupling is tried; joint errors of 2 deg leave it
_MISFIT_RATIO = 5.0  # times less must a coupling leave
_COUPLING_RATIOS = (-1.0, 1.0)


def full_coupling(arm: Arm, data: Measurements) -> JointCoupling | None:
    """The coupling of ratio ±1 without which no base and no tool lets the nominal arm come near the data, if any.

    The controller counts the angle of a joint from the horizon or from another link, so that its value is off by all
    of another joint's: no small effect, and none that a linear search could find.

    All ordered pairs of turning joints are tried, ratio +1 and −1, against an affine fit of the nominal tool points to
    the measured ones: it needs neither base nor tool.

    Returns:
        The coupling ``q_b ← q_b + ratio · q_a``; None unless it leaves a fifth of the misfit, or the arm has it
            already.
    """
    robot, rows = arm.robot, sample_rows(data)
    q = carried_joint_values(arm, data.q[rows])

    def misfit(values: Array) -> float:
        if data.position is None:
            return touch_misfit(robot, values, data.point[rows])
        return affine_fit(robot, values, data.position[rows][:, data.measured_axes]).misfit

    if data.position is None and not data.touches:
        return None
    now = misfit(q)
    if not now > _POOR_MISFIT:
        return None
    turning = [i for i, joint in enumerate(robot.joints) if joint.type == "revolute" and np.ptp(q[:, i]) > 0]
    tried = []
    for a, b in permutations(turning, 2):
        for ratio in _COUPLING_RATIOS:
            other = q.copy()
            other[:, b] += ratio * q[:, a]
            tried.append((misfit(other), a, b, ratio))
    left, a, b, ratio = min(tried, default=(np.inf, 0, 0, 0.0))
    if not left < now / _MISFIT_RATIO:
        return None
    names = robot.joint_names
    found = JointCoupling(joint=names[b], follows=names[a], estimate={"ratio": ratio})
    return None if found.name in {effect.name for effect in arm.effects} else found


def fitted_ratio(coupling: JointCoupling, fit: Fit) -> tuple[float, float]:
    """The ratio of a coupling that the arm of a fit has, and its standard error, to first order about the fit.

    The step is that of linear regression, ``− zᵀr / zᵀz``, with the column z of the coupling projected off all that was
    fitted.
    """
    used = fit.residuals.take(np.flatnonzero(fit.kept))
    r, J = used.residuals_and_jacobian(fit.x)
    A = np.linalg.qr(J @ fit.directions)[0]
    (z,) = EffectSensitivities(used, fit.x).columns(coupling).T
    z, r = (v - A @ (A.T @ v) for v in (z, r))
    length = max(float(z @ z), 1e-300)
    return float(coupling.values[0] - z @ r / length), float(np.sqrt(fit.variance / length))
