"""A joint that is logged relative to another: the coupling J2-J3 of parallelogram arms and some controllers."""

from __future__ import annotations

import numpy as np

from posture_opt.calibration.estimation.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.readings.reading_search import fitting_readings, sample_of
from posture_opt.measurements.readings.readings import coupling_readings
from posture_opt.model.arm import Arm
from posture_opt.model.effects import JointCoupling


def full_coupling(arm: Arm, data: Measurements, measurement: object) -> JointCoupling | None:
    """The coupling of ratio ±1 without which no base and no tool lets the nominal arm come near the data, if any.

    The controller counts the angle of a joint from the horizon or from another link, so that its value is off by all
    of another joint's: no small effect, and none that a linear search could find.

    Args:
        measurement: the instrument's standard deviations.

    Returns:
        The coupling ``q_b ← q_b + ratio · q_a``; None unless it explains the rows where nothing simpler does, or the
            arm has it already.
    """
    sample = sample_of(data, arm, measurement)
    if sample is None:
        return None
    _, fits = fitting_readings(sample, arm, lambda: [*coupling_readings(arm.robot)])
    found = next((reading.coupling for reading, _ in fits), None)
    if found is None:
        return None
    joint, follows, ratio = found
    coupling = JointCoupling(joint=joint, follows=follows, estimate={"ratio": ratio})
    return None if coupling.name in {effect.name for effect in arm.effects} else coupling


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
