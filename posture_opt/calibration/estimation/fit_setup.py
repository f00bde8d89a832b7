"""What is known of an arm's parameters: by the data to come, by stated σ's, and by how parts are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.error_statistics import design_effect
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.identifiability import (
    ANGLE_TOLERANCE_RAD,
    LENGTH_TOLERANCE_M,
    Identifiability,
    identify_parameters,
)
from posture_opt.calibration.estimation.least_squares import reduced_jacobian, robust_noise, unexplained_residuals
from posture_opt.calibration.estimation.parameters import Parameter, Prior, prior_covariance
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.calibration.estimation.starting_values import offset_of_tool, tool_sigma
from posture_opt.errors import enumerated
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData


@dataclass(frozen=True)
class Tolerance:
    """What is known of parts of one sort before any is measured."""

    noun: str  # of the parts, in plural
    median: float  # τ₀ [m or rad]
    spread: float  # s, standard deviation of ``ln τ``

    @property
    def start(self) -> float:
        """``√E τ² = τ₀ exp(s²)`` [m or rad], with no data."""
        return self.median * float(np.exp(self.spread**2))


@dataclass(frozen=True, eq=False)
class Widths:
    """(k,) standard deviations of parts by manufacturing [rad, m]; NaN where none is assumed."""

    typical: Array  # ``exp E ln τ``, by which a part weighs in the estimate
    uncertain: Array  # ``√E τ²``, which the errors of the estimate count with

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


def assumed_widths(residuals: Residuals, stated: Sequence[int]) -> Widths:
    """Of parameters of the geometry, with nothing measured."""
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
    """The assumed widths as the data ask for them, to first order about a fit whose prior they are."""
    own = assumed.own
    if not fit.design * fit.variance > 0:  # what is met without any error says nothing of the parts
        return assumed
    seen = _Evidence.of(fit, assumed, own)
    sorts = sorts_of_parts(fit.residuals, own)
    typical, uncertain = assumed.typical.copy(), assumed.uncertain.copy()
    for _ in range(20):
        last = typical.copy()
        for sort in np.unique(sorts):
            mine = sorts == sort
            typical[own[mine]], uncertain[own[mine]] = _width(seen, TOLERANCES[sort], mine, typical[own] ** 2)
        # 1e-3 relative change of τ at which it has settled.
        if np.max(np.abs(typical[own] / last[own] - 1)) <= 1e-3:
            break
    return Widths(typical, uncertain)


@dataclass(frozen=True, eq=False)
class _Evidence:
    """The sum of squares ``½ zᵀMz + gᵀz + ½ |(x + Bz)/τ|²`` of steps z (r,) about a fit."""

    M: Array  # (r, r) information of the data and of what is known beside the tolerances
    g: Array  # (r,) half the slope of their sum of squares
    B: Array  # (n, r) what steps move of the parts; x: (n,) where these are [rad, m]
    x: Array

    @classmethod
    def of(cls, fit: Fit, assumed: Widths, own: Codes) -> _Evidence:
        """Of the rows that count, by steps of comparable weight."""
        used = fit.residuals.take(np.flatnonzero(fit.kept))
        r, J = used.residuals_and_jacobian(fit.x)
        D, noise = fit.directions, np.sqrt(fit.design * fit.variance)
        assert fit.prior is not None, "a fit with tolerances has a prior"
        W, widths = fit.prior.matrix(len(fit.x)), assumed.typical
        others = W.T @ W - np.diag(np.where(np.isfinite(widths), 1 / widths**2, 0.0))  # known beside the widths
        A = reduced_jacobian(J, D) / noise
        M, g, B = A.T @ A + D.T @ others @ D, A.T @ r / noise + D.T @ others @ fit.x, D[own]
        weight = np.diag(M) + np.sum((B / assumed.typical[own, None]) ** 2, axis=0)
        unit = 1 / np.sqrt(np.where(weight > 0, weight, 1.0))
        M, B = unit[:, None] * M * unit, B * unit
        # Steps that no information reaches move nothing, and have no evidence.
        information, steps = np.linalg.eigh(M + B.T @ (B / assumed.typical[own, None] ** 2))
        Q = steps[:, information > len(M) * np.finfo(float).eps * information[-1]]
        return cls(Q.T @ M @ Q, Q.T @ (unit * g), B @ Q, fit.x[own])

    def logarithm(self, variance: Array) -> Array:
        """(t,) log evidence of variances (t, n) of the parts, without their own normalisation."""
        P = self.M + np.einsum("pi,tp,pj->tij", self.B, 1 / variance, self.B)
        slope = self.g + np.einsum("pi,tp->ti", self.B, self.x / variance)
        z = np.linalg.solve(P, slope[..., None])[..., 0]
        least = np.sum(self.x**2 / variance, axis=1) - np.sum(slope * z, axis=1)
        return np.asarray(-0.5 * (np.linalg.slogdet(P)[1] + least))


def _width(seen: _Evidence, tolerance: Tolerance, mine: Mask, variance: Array) -> tuple[float, float]:
    """``exp E ln τ`` and ``√E τ²`` of the parts ``mine`` (n,), the ``variance`` (n,) of the others as it is."""
    t = tolerance.spread * np.linspace(-_REACH, _REACH, 41)
    square = tolerance.median**2 * np.exp(2 * t)
    each = np.where(mine, square[:, None], variance)
    number = np.linalg.matrix_rank(seen.B[mine])
    weight = seen.logarithm(each) - number * t - 0.5 * (t / tolerance.spread) ** 2
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    return tolerance.median * float(np.exp(weight @ t)), float(np.sqrt(weight @ square))


NOMINAL_NOTE = (
    f"the data determine {{}} less well than to {LENGTH_TOLERANCE_M * 1e3:g} mm or "
    f"{ANGLE_TOLERANCE_RAD * 1e3:.3g} mrad: geometry is taken to lie within that of its nominal value (one σ)"
)


@dataclass(frozen=True, eq=False)
class FitSetup:
    """Which directions a calibration fits, and with what prior; decided once, at the nominal model."""

    identifiability: Identifiability  # what the data alone determine
    directions: Array  # (k, r) the steps that are fitted [rad or m]
    fixed: Mask  # (k,) whether data, or stated σ's, determine the parameter
    prior: Prior | None  # of the fit, or ``None``
    stated: Array  # (k,) the stated σ of each parameter that counts as knowledge; NaN where there is none
    # standard deviation that weighs the prior, in units of the instrument's: the residuals', times √design
    noise: float
    design: float  # how many rows say as much as one alone would, as neighbouring postures err alike
    held: Array  # (k, h) steps of a tolerance each that nothing determines: they are not fitted [rad or m]
    notes: tuple[str, ...]  # sentences on what was assumed
    widths: Widths  # of parts by manufacturing

    @property
    def assumed(self) -> Array:
        """(k,) how far parts are uncertain by manufacturing alone [rad, m]; NaN where none is assumed."""
        return self.widths.uncertain


def _block_diagonal(covariance: Array, variances: Array) -> Array:
    """A covariance (p, p) with further independent variances (q,) behind it."""
    p = len(covariance)
    wide = np.diag(np.r_[np.zeros(p), variances])
    wide[:p, :p] = covariance
    return wide


def determine_directions(
    problem: ProblemData, residuals: Residuals, x: Array, held: int | None, priors: bool,
    found: Fit | None = None, widths: Widths | None = None, noise: float = np.inf,
) -> FitSetup:  # fmt: skip
    """What measurements determine at the deviations ``x``, by themselves and with what is known beforehand.

    x (k,) deviations [rad, m]; held: the parameter that is held as the size of the arm, or None.
    """
    parameters, rows = residuals.parameters, len(residuals.data)
    names, k = [p.name for p in parameters], len(parameters)
    J = residuals.residuals_and_jacobian(x)[1]
    spread, design = _noise_and_design(residuals, x, found)
    spread = min(spread * float(np.sqrt(design)), noise)
    notes = (f"neighbouring postures err alike: for standard errors, {design:.2g} rows count as one",) * (design > 1)
    indices, covariance = prior_covariance(problem, parameters) if priors else ([], np.zeros((0, 0)))
    scale, nothing = prior_tolerances(parameters, indices), np.full(k, np.nan)
    made = (widths or assumed_widths(residuals, indices)) if priors else Widths(nothing, nothing)
    weighing = _block_diagonal(covariance, made.typical[made.own] ** 2)
    covariance = _block_diagonal(covariance, made.uncertain[made.own] ** 2)
    indices, own = [*indices, *made.own.tolist()], np.isfinite(made.uncertain)
    scale = np.where(own, made.uncertain, scale)
    alone = identify_parameters(names, J, rows, held, scale=scale, noise=spread)
    stated = nothing.copy()
    stated[indices] = np.sqrt(np.diag(covariance))
    if not priors:
        rest = scale[:, None] * alone.null
        return FitSetup(alone, alone.directions, alone.determined, None, stated, spread, design, rest, notes, made)
    both = alone
    if indices:
        known = Prior.of(indices, covariance).matrix(k)
        both = identify_parameters(names, np.concatenate([J / spread, known]), rows, held, scale=scale)
    fixed = both.determined | (np.isfinite(stated) & (np.arange(k) != (-1 if held is None else held)))
    # 0.5 of a tolerance by manufacturing: what data leave less of, they determine; of the variance, a quarter.
    fixed = np.where(own, both.alone < 0.5 * scale, fixed)
    prior = full_prior(parameters, problem.robot, scale, indices, covariance)
    if own.any():
        prior = full_prior(parameters, problem.robot, scale, indices, weighing).counted_as(prior)
    elif both.hardly.shape[1]:
        parts = np.abs(both.hardly / both.scale[:, None]).max(axis=1)
        most = [names[i] for i in np.argsort(-parts, kind="stable") if parts[i] > 0.3 * parts.max()][:4]
        notes = (*notes, NOMINAL_NOTE.format(enumerated(most)))
    directions = np.concatenate([both.directions, both.hardly], axis=1)
    rest = scale[:, None] * both.vectors[:, directions.shape[1] :]
    return FitSetup(alone, directions, fixed, prior, stated, spread, design, rest, notes, made)


def unseen_errors_of_fit(residuals: Residuals, known: FitSetup, found: Fit, length: int | None) -> Array:
    """(k,) part of the standard errors that combinations leave which nothing determines [rad, m].

    What is held moves nothing at the nominal arm, but something at the fitted one: a tool of unknown length, on an axis
    found tilted, is displaced sideways, and the estimates make up for it. For steps H that are held, at D that are
    fitted, the estimate errs by ``H − D (AᵀA)⁻¹ (J D)ᵀ J H``, the normal equations' at the fitted arm.
    """
    J = residuals.take(np.flatnonzero(found.kept)).residuals_and_jacobian(found.x)[1]
    if length is not None:
        J[:, length] = 0.0
    inverse = known.directions @ np.linalg.pinv(found.minimum.R, rcond=1e-14)
    moved = known.held - inverse @ (inverse.T @ (J.T @ (J @ known.held)))
    return np.asarray(np.linalg.norm(moved, axis=1))


def _noise_and_design(residuals: Residuals, x: Array, found: Fit | None) -> tuple[float, float]:
    if found is not None:
        residuals, x = residuals.take(np.flatnonzero(found.kept)), found.x
    r, J = residuals.residuals_and_jacobian(x)
    r, J = r[: residuals.measured], J[: residuals.measured]
    if len(r) <= J.shape[1]:
        return 1.0, 1.0
    rest = unexplained_residuals(r, J)
    return max(robust_noise(r, J, residuals.block), 1.0), design_effect(residuals, rest, J)


def prior_tolerances(parameters: Sequence[Parameter], stated: list[int]) -> Array:
    """How far each unknown may be off beforehand [rad or m]: geometry, and frames of which a σ is stated, not far."""
    part = {"m": LENGTH_TOLERANCE_M, "rad": ANGLE_TOLERANCE_RAD}
    # 1 m or rad is unknown of a free frame or a touched point
    return np.array([part.get(p.unit, 1.0) if p.made or i in stated else 1.0 for i, p in enumerate(parameters)])


def full_prior(
    parameters: Sequence[Parameter], robot: Robot, scale: Array, stated: list[int], covariance: Array
) -> Prior:
    """Stated σ's, for the rest of the geometry its tolerance, and for the offsets of free tools the arm's size.

    scale (k,) tolerances; stated: indices with a stated σ, whose covariance is ``covariance``.
    """
    sigma = np.where([offset_of_tool(p) for p in parameters], tool_sigma(robot), scale)
    rest = [i for i, p in enumerate(parameters) if (p.made or offset_of_tool(p)) and i not in stated]
    return Prior.of([*stated, *rest], _block_diagonal(covariance, sigma[rest] ** 2))
