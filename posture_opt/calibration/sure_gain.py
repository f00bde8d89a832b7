"""How probable it is that a calibrated arm is nearer to the true one than the nominal arm, which is kept otherwise."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.numerics import Array, stacked_rows

LEAST_PROBABILITY = 0.9
"""With which a calibrated arm must be better than the nominal one to be delivered. Where an instrument scatters twice
as much as an arm errs, one in ten fits is worse than nominal even with the true tolerances and the true σ.
"""


def probability_of_gain(fit: Fit, x_nominal: Array) -> float:
    """``Φ(|u|² / 2s)``: that positions at the fitted rows are nearer to the true ones with ``x`` than with ``x₀``.

    They change by ``u = P J (x − x₀)``, where P takes out what a motion of the base does, and those of ``x`` err by
    ``P J e`` with e of covariance C; those of ``x₀`` by ``P J e + u``, which is longer where ``2 uᵀJe > −|u|²``;
    ``s² = uᵀ J C Jᵀ u``.

    Args:
        x_nominal: x₀ (k,), only free frames and places fitted [rad, m].
    """
    J = _positions_without_base(fit)
    u = J @ (fit.x - x_nominal)
    slope = J.T @ u
    s = float(np.sqrt(np.maximum(slope @ fit.covariance @ slope, 0.0)))
    return NormalDist().cdf(float(u @ u) / (2 * s)) if s > 0 else 0.5


def _positions_without_base(fit: Fit) -> Array:
    """(3N, k) ``P J`` of the tool's positions at the rows that count [m/rad or m/m]."""
    used = fit.residuals.take(np.flatnonzero(fit.kept))
    n, reached = len(used.data), used.walk(fit.x)
    own = [i for i, p in enumerate(used.parameters) if p.source]
    twists = used.arm.twists([used.parameters[i].source for i in own], used.q, reached, used.deviations(fit.x))
    J = np.zeros((n, 3, len(fit.x)))
    for i, (shift, _) in zip(own, twists, strict=True):
        rows = used.parameters[i].code < 0 or used.data.target == used.parameters[i].code
        J[:, :, i] = np.where(np.reshape(rows, (-1, 1)), stacked_rows(shift, n), 0.0)
    p = stacked_rows(reached.position, n)
    shifts = np.broadcast_to(np.eye(3), (n, 3, 3))
    turns = np.stack([np.cross(axis, p - p.mean(axis=0)) for axis in np.eye(3)], axis=2)
    base = np.linalg.qr(np.concatenate([shifts, turns], axis=2).reshape(3 * n, 6))[0]
    flat = J.reshape(3 * n, -1)
    return np.asarray(flat - base @ (base.T @ flat))
