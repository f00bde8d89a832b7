"""How far measured orientations scatter beside positions: one stated σ may be wrong, and a fit weighs both by them."""

from __future__ import annotations

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.least_squares import reduced_jacobian
from posture_opt.measurements.repeats import Contrasts
from posture_opt.numerics import Array

_MIN_RATIO = 1.5
"""Ratio from which on orientations are weighed anew: with less, a fit loses at the most a seventh of its information,
``4 k / (1 + k)²`` for a variance that is wrong by k."""
_LEVEL = 0.002
"""Level at which both scatter alike."""
_MIN_REPEAT_FREEDOM = 12
"""Degrees of freedom from which on repeats decide alone: a σ is then known to a fifth."""


def orientation_ratio(fit: Fit) -> float:
    """How many times as far orientations scatter as positions, each in units of the σ that weighs it; 1 where as far.

    ``√((Σ e_r² / ν_r) / (Σ e_p² / ν_p))`` over contrasts of repeats, which no error of the model is in, or else over
    what the fit leaves, with the degrees of freedom that it leaves to each (Förstner 1979). It is 1 where an F test
    does not find them different, where they differ by less than half, and where no orientation counts.
    """
    residuals = fit.residuals
    if not residuals.data.kind.further:
        return 1.0
    kept = np.flatnonzero(fit.kept)
    data = residuals.data.take(kept)
    e = fit.whitened.reshape(-1, residuals.block)[kept]
    slides = np.array([joint.type == "prismatic" for joint in residuals.robot.joints])
    for contrasts in (Contrasts.of(data, slides), Contrasts.of_readings(data)):
        if 3 * len(contrasts) >= _MIN_REPEAT_FREEDOM:
            pure = contrasts.differences(e) / np.sqrt(contrasts.reading)[:, None]
            return _ratio(pure, np.ones(pure.shape), len(residuals.axes))
    J = reduced_jacobian(fit.jacobian, fit.directions).reshape(len(fit.kept), residuals.block, -1)[kept]
    Q, _ = np.linalg.qr(J.reshape(e.size, -1))
    return _ratio(e, 1 - np.sum(Q**2, axis=1).reshape(e.shape), len(residuals.axes))


def _ratio(e: Array, left: Array, axes: int) -> float:
    """The ratio of the scatter of the last coordinates of residuals e (N, d) to that of the first ``axes`` of them.

    ``left`` (N, d) is the degree of freedom that each of them has.
    """
    from scipy.special import fdtr, fdtrc

    square, freedom = (np.array([np.sum(v[:, :axes]), np.sum(v[:, axes:])]) for v in (e**2, left))
    if np.min(freedom) < 1 or np.min(square) <= 0:
        return 1.0
    F = float(np.divide(*(square / freedom)[::-1]))
    p = 2 * float(min(fdtr(*freedom[::-1], F), fdtrc(*freedom[::-1], F)))
    ratio = float(np.sqrt(F))
    return ratio if p < _LEVEL and max(ratio, 1 / ratio) > _MIN_RATIO else 1.0
