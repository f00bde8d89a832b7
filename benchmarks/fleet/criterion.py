"""The criteria of the tasks in NumPy, with slopes: smooth for the brute force, exact for the judge."""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr

from posture_opt.numerics import Array

_FINE, _COARSE = 180, 60  # nodes of the periodic rule, of the judge and of the descent
_NUDGE = 1e-30  # of a complex step: the derivative to rounding


def exact(criterion: str, C: Array, bias: Array, clearance: float) -> Array:
    """(N,) what is compared: a standard deviation [m], or for ``miss`` the logarithm of the probability."""
    if criterion == "miss":
        return log_miss(C, bias, clearance)
    values = np.maximum(np.linalg.eigvalsh(C), 0.0)
    if criterion == "worst":
        return np.asarray(np.sqrt(values[:, -1]))
    if criterion == "trace":
        return np.asarray(np.sqrt(values.sum(axis=1)))
    return np.asarray(np.prod(values, axis=1) ** (0.5 / C.shape[1]))


def smooth(
    criterion: str, C: Array, bias: Array, dC: Array, db: Array, clearance: float, power: float
) -> tuple[Array, Array]:
    """(N,) logarithm of the variance (or of the probability to miss) and its slope (N, n).

    The largest eigenvalue is the ``power``-norm of all of them, which has a slope where two are equal.
    """
    if criterion == "miss":
        return _miss_with_slope(C, bias, dC, db, clearance)
    if criterion == "trace":
        total = np.trace(C, axis1=1, axis2=2)
        return np.log(total), np.einsum("niik->nk", dC) / total[:, None]
    values, vectors = np.linalg.eigh(C)
    values = np.maximum(values, 1e-12 * values[:, -1:])
    slopes = np.einsum("nim,nijk,njm->nmk", vectors, dC, vectors)
    if criterion == "area":
        m = C.shape[1]
        return np.log(values).sum(axis=1) / m, (slopes / values[:, :, None]).sum(axis=1) / m
    top = values[:, -1:]
    relative = values / top
    total = (relative**power).sum(axis=1)
    weights = relative ** (power - 1) / (top * total[:, None])
    return np.log(top[:, 0]) + np.log(total) / power, np.einsum("nm,nmk->nk", weights, slopes)


def log_miss(C: Array, bias: Array, clearance: float, nodes: int = _FINE) -> Array:
    """(N,) logarithm of the probability that a Gaussian point (m = 1 or 2) lies beyond the clearance.

    For m = 2, P = mean over φ of exp(−ρ²/2), where ``bias + ρ L u(φ)`` leaves the circle (L Cholesky factor of C).
    """
    if C.shape[1] == 1:
        sigma, b = np.sqrt(C[:, 0, 0]), bias[:, 0]
        return np.asarray(np.logaddexp(log_ndtr(-(clearance - b) / sigma), log_ndtr(-(clearance + b) / sigma)))
    angles = 2 * np.pi * np.arange(nodes) / nodes
    cosine, sine = np.cos(angles), np.sin(angles)
    l11 = np.sqrt(C[:, 0, 0] * (1 + 1e-12))
    l21 = C[:, 0, 1] / l11
    l22 = np.sqrt(C[:, 1, 1] - l21 * l21 + 1e-12 * (C[:, 0, 0] + C[:, 1, 1]))
    d0, d1 = np.outer(l11, cosine), np.outer(l21, cosine) + np.outer(l22, sine)
    alpha, beta = d0 * d0 + d1 * d1, bias[:, :1] * d0 + bias[:, 1:] * d1
    gap = clearance**2 - (bias * bias).sum(axis=1, keepdims=True)
    rho = gap / (beta + np.sqrt(beta * beta + alpha * gap))
    exponents = -rho * rho / 2
    peak = exponents.real.max(axis=1)
    return np.asarray(peak + np.log(np.exp(exponents - peak[:, None]).mean(axis=1)))


def _miss_with_slope(C: Array, bias: Array, dC: Array, db: Array, clearance: float) -> tuple[Array, Array]:
    if C.shape[1] == 1:
        return _line_miss_with_slope(C, bias, dC, db, clearance)
    value, slope = log_miss(C, bias, clearance, _COARSE), np.zeros((len(C), dC.shape[-1]))
    for i, j in ((0, 0), (0, 1), (1, 1)):
        step = C.astype(complex)
        step[:, i, j] += 1j * _NUDGE
        step[:, j, i] = step[:, i, j]
        slope += (log_miss(step, bias.astype(complex), clearance, _COARSE).imag / _NUDGE)[:, None] * dC[:, i, j]
    for i in range(2):
        step = bias.astype(complex)
        step[:, i] += 1j * _NUDGE
        slope += (log_miss(C.astype(complex), step, clearance, _COARSE).imag / _NUDGE)[:, None] * db[:, i]
    return value, slope


def _line_miss_with_slope(C: Array, bias: Array, dC: Array, db: Array, clearance: float) -> tuple[Array, Array]:
    h = 1e-6 * C[:, :1, :1]
    of_c = (log_miss(C + h, bias, clearance) - log_miss(C - h, bias, clearance)) / (2 * h[:, 0, 0])
    t = 1e-6 * np.sqrt(C[:, 0])
    of_b = (log_miss(C, bias + t, clearance) - log_miss(C, bias - t, clearance)) / (2 * t[:, 0])
    return log_miss(C, bias, clearance), of_c[:, None] * dC[:, 0, 0] + of_b[:, None] * db[:, 0]
