"""How far parts of an arm are from their nominal values: by manufacturing, and by what the data show of it.

Plates, wires and sockets leave much of a geometry open, and may scatter more than the arm errs: fitted freely, the arm
would get worse. Each parameter is taken to be normal about its nominal value instead, with one standard deviation τ for
all, of lengths in mm and of angles in mrad, whose own prior is the tolerance of machined parts:
``τ² ~ ν τ₀² / χ²(ν)``. The data make it larger or smaller: τ is where the expectation of the squares is its own, given
the measurements (EM; MacKay 1992, "evidence"); its posterior mean, ``(ν τ₀² + Σ E x²) / (ν + n − 2)`` of n parameters.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.least_squares import reduced_jacobian
from posture_opt.calibration.estimation.parameters import Parameter
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.numerics import Array

LENGTH_SIGMA_M = 0.2e-3
"""τ₀: the mean of ``ν τ₀² / χ²(ν)`` is (0.28 mm)²; ISO 2768-1, medium: ±0.5 mm for 120 to 400 mm, a σ of 0.29 mm."""
ANGLE_SIGMA_RAD = 0.2e-3
"""τ₀ of axes, and of zeros of joints: 0.2 mm at a lever of 1 m."""
PRIOR_FREEDOM = 4.0
"""ν: the tolerance counts as much as four parameters would whose deviations were known."""
_MAX_ROUNDS = 200
_SETTLED = 1e-3
"""Relative change of τ at which it has settled."""


def assumed_sigmas(residuals: Residuals, stated: Sequence[int]) -> Array:
    """(k,) standard deviations of parameters of the geometry by manufacturing [rad, m]; NaN where none is assumed.

    None is for positions and poses, which show the whole geometry, for frames, and where the file states one.
    """
    found = np.full(len(residuals.parameters), np.nan)
    if not residuals.data.kind.leaves_geometry_open:
        return found
    for i, p in enumerate(residuals.parameters):
        if p.made and i not in stated:
            found[i] = _sigma(p)
    return found


def sigmas_of_data(fit: Fit, assumed: Array) -> Array:
    """(k,) the assumed standard deviations as the data ask for them, to first order about a fit.

    Args:
        assumed: (k,) those of the prior of the fit; NaN where none is.
    """
    own = np.flatnonzero(np.isfinite(assumed))
    unit = np.array([_sigma(fit.residuals.parameters[i]) for i in own])
    used = fit.residuals.take(np.flatnonzero(fit.kept))
    r, J = used.residuals_and_jacobian(fit.x)
    D, noise = fit.directions, fit.design * fit.variance
    if not np.all(noise > 0):  # what is met without any error says nothing of the parts
        return assumed
    A, others = reduced_jacobian(J, D) / np.sqrt(noise), _information_of_others(fit, assumed)
    M, slope = A.T @ A + D.T @ others @ D, A.T @ r / np.sqrt(noise) + D.T @ others @ fit.x
    size, B, x0 = float(assumed[own[0]] / unit[0]), D[own] / unit[:, None], fit.x[own] / unit
    for _ in range(_MAX_ROUNDS):
        C = np.linalg.pinv(M + B.T @ B / size**2, hermitian=True)
        x = x0 - B @ (C @ (slope + B.T @ x0 / size**2))
        squares = float(x @ x) + float(np.einsum("ij,jk,ik->", B, C, B))
        last, size = size, float(np.sqrt((PRIOR_FREEDOM + squares) / (PRIOR_FREEDOM + len(own) - 2)))
        if abs(size - last) <= _SETTLED * last:
            break
    found = assumed.copy()
    found[own] = unit * size
    return found


def _information_of_others(fit: Fit, assumed: Array) -> Array:
    """(k, k) information of what is known beside the ``assumed`` standard deviations (k,)."""
    assert fit.prior is not None
    W = fit.prior.matrix(len(fit.x))
    return np.asarray(W.T @ W - np.diag(np.where(np.isfinite(assumed), 1 / assumed**2, 0.0)))


def _sigma(parameter: Parameter) -> float:
    """τ₀ of a parameter of the geometry [m or rad]."""
    return LENGTH_SIGMA_M if parameter.unit == "m" else ANGLE_SIGMA_RAD
