"""How far parts of an arm are from their nominal values: by manufacturing, and by what the data show of it.

Plates, wires and sockets leave much of a geometry open, and may scatter more than the arm errs: fitted freely, the arm
would get worse. Each parameter is taken to be normal about its nominal value instead, with one standard deviation τ for
all lengths, one for all axes, and one for the zeros of all joints, since a machined link and a zero set by hand differ
tenfold. Each τ is log-normal beforehand, ``ln τ ~ N(ln τ₀, s²)``, and given the data has the density
``p(τ) det(M + BᵀB/τ²)^(-1/2) τ^(-n) exp(-F(τ))`` of the evidence to first order (MacKay 1992), F the minimum of the sum
of squares. What counts is ``E τ²``, the variance that it leaves a part of which nothing is seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.least_squares import reduced_jacobian
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.numerics import Array, Codes


@dataclass(frozen=True)
class Tolerance:
    """What is known of parts of one sort before any is measured.

    Args:
        noun: of the parts, in plural.
        median: τ₀ [m or rad].
        spread: s, standard deviation of ``ln τ``.
    """

    noun: str
    median: float
    spread: float

    @property
    def start(self) -> float:
        """``√E τ² = τ₀ exp(s²)`` [m or rad], with no data."""
        return self.median * float(np.exp(self.spread**2))


TOLERANCES = (
    Tolerance("lengths", 0.3e-3, 0.8),
    Tolerance("axes", 0.3e-3, 0.8),
    Tolerance("zeros of joints", 0.3e-3, 1.2),
)
"""τ₀: ISO 2768-1, medium: ±0.5 mm for 120 to 400 mm, a σ of 0.29 mm; of angles as much at a lever of 1 m. Spreads: five
measured arms (UR5, UR10, two Pandas, iiwa), whose lengths scatter by 0.08 to 0.6 mm, axes by 0.3 to 2, zeros by 0.3 to
10 mrad.
"""
_LENGTHS, _AXES, _ZEROS = range(3)
_REACH = 3.5  # standard deviations of ln τ that the quadrature covers, and its nodes
_NODES = 41
_MAX_ROUNDS = 20
_SETTLED = 2e-3
"""Relative change of τ² at which it has settled."""


def assumed_sigmas(residuals: Residuals, stated: Sequence[int]) -> Array:
    """(k,) standard deviations of parameters of the geometry by manufacturing [rad, m]; NaN where none is assumed.

    None is for positions and poses, which show the whole geometry, for frames, and where the file states one.
    """
    found = np.full(len(residuals.parameters), np.nan)
    if not residuals.data.kind.leaves_geometry_open:
        return found
    own = [i for i, p in enumerate(residuals.parameters) if p.made and i not in stated]
    found[own] = [TOLERANCES[sort].start for sort in sorts_of_parts(residuals, own)]
    return found


def sorts_of_parts(residuals: Residuals, rows: Sequence[int] | Codes) -> Codes:
    """Which of `TOLERANCES` each of some parameters has: lengths, zeros (``JOINT.theta``), other angles."""
    chosen = [residuals.parameters[i] for i in rows]
    return np.array(
        [_LENGTHS if p.unit == "m" else _ZEROS if p.name.endswith(".theta") else _AXES for p in chosen], dtype=np.intp
    )


def sigmas_of_data(fit: Fit, assumed: Array) -> Array:
    """(k,) the assumed standard deviations as the data ask for them, to first order about a fit.

    Args:
        assumed: (k,) those of the prior of the fit; NaN where none is.
    """
    own = np.flatnonzero(np.isfinite(assumed))
    if not fit.design * fit.variance > 0:  # what is met without any error says nothing of the parts
        return assumed
    seen = _Evidence.of(fit, assumed, own)
    sorts = sorts_of_parts(fit.residuals, own)
    variance = assumed[own] ** 2
    for _ in range(_MAX_ROUNDS):
        last = variance
        for sort in np.unique(sorts):
            mine = sorts == sort
            variance = np.where(mine, _mean_square(seen, TOLERANCES[sort], mine, variance), variance)
        if np.max(np.abs(variance / last - 1)) <= _SETTLED:
            break
    found = assumed.copy()
    found[own] = np.sqrt(variance)
    return found


@dataclass(frozen=True, eq=False)
class _Evidence:
    """The sum of squares ``½ zᵀMz + gᵀz + ½ |(x + Bz)/τ|²`` of steps z (r,) about a fit.

    Args:
        M: (r, r) information of the data and of what is known beside the tolerances.
        g: (r,) half the slope of their sum of squares.
        B: (n, r) what steps move of the parts; x: (n,) where these are [rad, m].
    """

    M: Array
    g: Array
    B: Array
    x: Array

    @classmethod
    def of(cls, fit: Fit, assumed: Array, own: Codes) -> _Evidence:
        """Of the rows that count, by steps of comparable weight."""
        used = fit.residuals.take(np.flatnonzero(fit.kept))
        r, J = used.residuals_and_jacobian(fit.x)
        D, noise = fit.directions, np.sqrt(fit.design * fit.variance)
        A, others = reduced_jacobian(J, D) / noise, _information_of_others(fit, assumed)
        M, g, B = A.T @ A + D.T @ others @ D, A.T @ r / noise + D.T @ others @ fit.x, D[own]
        weight = np.diag(M) + np.sum((B / assumed[own, None]) ** 2, axis=0)
        unit = 1 / np.sqrt(np.where(weight > 0, weight, 1.0))
        return cls(unit[:, None] * M * unit, unit * g, B * unit, fit.x[own])

    def logarithm(self, variance: Array) -> Array:
        """(t,) log evidence of variances (t, n) of the parts, without their own normalisation."""
        P = self.M + np.einsum("pi,tp,pj->tij", self.B, 1 / variance, self.B)
        slope = self.g + np.einsum("pi,tp->ti", self.B, self.x / variance)
        z = np.linalg.solve(P, slope[..., None])[..., 0]
        least = np.sum(self.x**2 / variance, axis=1) - np.sum(slope * z, axis=1)
        return np.asarray(-0.5 * (np.linalg.slogdet(P)[1] + least))


def _mean_square(seen: _Evidence, tolerance: Tolerance, mine: Array, variance: Array) -> float:
    """``E τ²`` of the parts ``mine`` (n,), the ``variance`` (n,) of the others as it is."""
    t = tolerance.spread * np.linspace(-_REACH, _REACH, _NODES)
    square = tolerance.median**2 * np.exp(2 * t)
    each = np.where(mine, square[:, None], variance)
    number = np.linalg.matrix_rank(seen.B[mine])
    weight = seen.logarithm(each) - number * t - 0.5 * (t / tolerance.spread) ** 2
    weight = np.exp(weight - weight.max())
    return float(weight @ square / weight.sum())


def _information_of_others(fit: Fit, assumed: Array) -> Array:
    """(k, k) information of what is known beside the ``assumed`` standard deviations (k,)."""
    assert fit.prior is not None
    W = fit.prior.matrix(len(fit.x))
    return np.asarray(W.T @ W - np.diag(np.where(np.isfinite(assumed), 1 / assumed**2, 0.0)))
