"""How far parts of an arm are from their nominal values: by manufacturing, and by what the data show of it.

Plates, wires and sockets leave much of a geometry open, and may scatter more than the arm errs: fitted freely, the arm
would get worse. Each parameter is taken to be normal about its nominal value instead, with one standard deviation τ for
all lengths, one for all axes, and one for the zeros of all joints, since a machined link and a zero set by hand differ
tenfold. Each τ is log-normal beforehand, ``ln τ ~ N(ln τ₀, s²)``, and given the data has the density
``p(τ) det(M + BᵀB/τ²)^(-1/2) τ^(-n) exp(-F(τ))`` of the evidence to first order (MacKay 1992), F the minimum of the sum
of squares.

Estimate and error ask for different widths. What an unseen part is uncertain by is ``√E τ²``. An estimate that weighs
its prior so follows noise, as large τ that hardly are true count most: ``exp E ln τ`` comes near the mean over all τ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.least_squares import reduced_jacobian
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.numerics import Array, Codes, Mask


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


@dataclass(frozen=True, eq=False)
class Widths:
    """(k,) standard deviations of parts by manufacturing [rad, m]; NaN where none is assumed.

    Args:
        typical: ``exp E ln τ``, by which a part weighs in the estimate.
        uncertain: ``√E τ²``, which the errors of the estimate count with.
    """

    typical: Array
    uncertain: Array

    @property
    def own(self) -> Codes:
        """(n,) indices of the parts."""
        return np.flatnonzero(np.isfinite(self.uncertain))


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
_SETTLED = 1e-3
"""Relative change of τ at which it has settled."""


def assumed_widths(residuals: Residuals, stated: Sequence[int]) -> Widths:
    """Of parameters of the geometry, with nothing measured.

    None is for positions and poses, which show the whole geometry, for frames, and where the file states one.
    """
    typical, uncertain = (np.full(len(residuals.parameters), np.nan) for _ in range(2))
    if residuals.data.kind.leaves_geometry_open:
        own = [i for i, p in enumerate(residuals.parameters) if p.made and i not in stated]
        sorts = [TOLERANCES[sort] for sort in sorts_of_parts(residuals, own)]
        typical[own], uncertain[own] = [sort.median for sort in sorts], [sort.start for sort in sorts]
    return Widths(typical, uncertain)


def sorts_of_parts(residuals: Residuals, rows: Sequence[int] | Codes) -> Codes:
    """Which of `TOLERANCES` each of some parameters has: lengths, zeros (``JOINT.theta``), other angles."""
    chosen = [residuals.parameters[i] for i in rows]
    return np.array(
        [_LENGTHS if p.unit == "m" else _ZEROS if p.name.endswith(".theta") else _AXES for p in chosen], dtype=np.intp
    )


def widths_of_data(fit: Fit, assumed: Widths) -> Widths:
    """The assumed widths as the data ask for them, to first order about a fit whose prior they are.

    The width of one sort is judged with those of the others at their typical values, in turn until these settle.
    """
    own = assumed.own
    if not fit.design * fit.variance > 0:  # what is met without any error says nothing of the parts
        return assumed
    seen = _Evidence.of(fit, assumed, own)
    sorts = sorts_of_parts(fit.residuals, own)
    typical, uncertain = assumed.typical.copy(), assumed.uncertain.copy()
    for _ in range(_MAX_ROUNDS):
        last = typical.copy()
        for sort in np.unique(sorts):
            mine = sorts == sort
            typical[own[mine]], uncertain[own[mine]] = _width(seen, TOLERANCES[sort], mine, typical[own] ** 2)
        if np.max(np.abs(typical[own] / last[own] - 1)) <= _SETTLED:
            break
    return Widths(typical, uncertain)


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
    def of(cls, fit: Fit, assumed: Widths, own: Codes) -> _Evidence:
        """Of the rows that count, by steps of comparable weight."""
        used = fit.residuals.take(np.flatnonzero(fit.kept))
        r, J = used.residuals_and_jacobian(fit.x)
        D, noise = fit.directions, np.sqrt(fit.design * fit.variance)
        A, others = reduced_jacobian(J, D) / noise, _information_of_others(fit, assumed.typical)
        M, g, B = A.T @ A + D.T @ others @ D, A.T @ r / noise + D.T @ others @ fit.x, D[own]
        weight = np.diag(M) + np.sum((B / assumed.typical[own, None]) ** 2, axis=0)
        unit = 1 / np.sqrt(np.where(weight > 0, weight, 1.0))
        M, B = unit[:, None] * M * unit, B * unit
        Q = _seen_by(M + B.T @ (B / assumed.typical[own, None] ** 2))
        return cls(Q.T @ M @ Q, Q.T @ (unit * g), B @ Q, fit.x[own])

    def logarithm(self, variance: Array) -> Array:
        """(t,) log evidence of variances (t, n) of the parts, without their own normalisation."""
        P = self.M + np.einsum("pi,tp,pj->tij", self.B, 1 / variance, self.B)
        slope = self.g + np.einsum("pi,tp->ti", self.B, self.x / variance)
        z = np.linalg.solve(P, slope[..., None])[..., 0]
        least = np.sum(self.x**2 / variance, axis=1) - np.sum(slope * z, axis=1)
        return np.asarray(-0.5 * (np.linalg.slogdet(P)[1] + least))


def _seen_by(P: Array) -> Array:
    """(r, s) unit steps that some information P (r, r) reaches: others move nothing, and have no evidence."""
    information, steps = np.linalg.eigh(P)
    return np.asarray(steps[:, information > len(P) * np.finfo(float).eps * information[-1]])


def _width(seen: _Evidence, tolerance: Tolerance, mine: Mask, variance: Array) -> tuple[float, float]:
    """``exp E ln τ`` and ``√E τ²`` of the parts ``mine`` (n,), the ``variance`` (n,) of the others as it is."""
    t = tolerance.spread * np.linspace(-_REACH, _REACH, _NODES)
    square = tolerance.median**2 * np.exp(2 * t)
    each = np.where(mine, square[:, None], variance)
    number = np.linalg.matrix_rank(seen.B[mine])
    weight = seen.logarithm(each) - number * t - 0.5 * (t / tolerance.spread) ** 2
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    return tolerance.median * float(np.exp(weight @ t)), float(np.sqrt(weight @ square))


def _information_of_others(fit: Fit, typical: Array) -> Array:
    """(k, k) information of what is known beside the parts' ``typical`` widths (k,)."""
    assert fit.prior is not None
    W = fit.prior.matrix(len(fit.x))
    return np.asarray(W.T @ W - np.diag(np.where(np.isfinite(typical), 1 / typical**2, 0.0)))
