"""The scatter of each joint, from repeats or from what a calibration leaves, tried at postures that it has not seen."""

from __future__ import annotations

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.residuals import Residuals
from posture_opt.errors import InsufficientDataError
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.validation.joint_prediction import HeldOut, predict_elsewhere
from posture_opt.validation.joint_variances import JointNoise, fit_scatter
from posture_opt.validation.prediction import joint_columns, joint_errors
from posture_opt.validation.residual_scatter import unseen_errors
from posture_opt.validation.scatter_between_repeats import COPY, Between, slides
from posture_opt.validation.scatter_model import Scatter, covariances

_LEVER = 0.01  # of the longest lever
_FEW = 4  # coordinates of scatter for each σ: with fewer, one for all joints is asked for


def joint_scatter(
    between: Between, used: Residuals, calibration: Calibration, groups: Codes
) -> tuple[JointNoise | None, tuple[HeldOut, ...]]:
    """σ of joints and instrument from repeats where there are any, else from what the calibration leaves.

    There the uncertainty of its parameters is a known part of every error, which is no instrument's.
    """
    names = joint_errors(used)
    if len(between.scatter.freedom):
        scatter, codes, stated = between.scatter, np.arange(len(between.scatter.freedom)), between.covariances
    else:
        left, known, _ = unseen_errors(calibration)
        scatter, codes = Scatter.of(left, joint_columns(used, calibration.x), known=known), groups
        stated = None
        if between.stated_sigma.any():
            stated = covariances(scatter.columns, between.stated_sigma, used.sigma) + known
    if not scatter.squares.max(initial=0.0) > COPY**2:
        return None, ()
    coordinates = float(scatter.freedom.sum()) * scatter.squares.shape[1]
    equal = coordinates < _FEW * (len(names) + 1)
    try:
        noise = fit_scatter(scatter, names, used.sigma, True, equal, bool(len(between.scatter.freedom)))
    except InsufficientDataError:
        return None, ()
    return noise, predict_elsewhere(scatter, names, codes, stated, used.sigma)


def worth_showing(residuals: Residuals, x: Array, noise: JointNoise | None) -> Mask:
    """(n,) whether the data could tell a joint's scatter: it moves the point, and its σ is determined."""
    lever = np.sqrt(np.mean(np.sum(joint_columns(residuals, x) ** 2, axis=1), axis=0))
    moving = lever > _LEVER * np.where(slides(residuals), 0.0, lever.max())
    return np.asarray(moving & (noise.determined if noise is not None else True))
