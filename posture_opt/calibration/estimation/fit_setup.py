"""What is known of an arm's parameters: by the data to come, by stated σ's, and by how parts are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.estimation.clustered_covariance import design_effect
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.identifiability import (
    ANGLE_TOLERANCE_RAD,
    LENGTH_TOLERANCE_M,
    Identifiability,
    identify_parameters,
)
from posture_opt.calibration.estimation.least_squares import robust_noise, unexplained_residuals
from posture_opt.calibration.estimation.parameters import Parameter, prior_covariance
from posture_opt.calibration.estimation.prior import Prior
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.calibration.estimation.starting_values import offset_of_tool, tool_sigma
from posture_opt.calibration.estimation.tolerances import Widths, assumed_widths
from posture_opt.errors import enumerated
from posture_opt.numerics import Array, Mask
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData

IMPROVED_SHARE = 0.5
"""Of a tolerance by manufacturing: what data leave less of, they determine; of the variance, a quarter."""
FREE_TOLERANCE = 1.0  # m or rad: what is unknown of a free frame or a touched point
DESIGN_NOTE = "neighbouring postures err alike: for standard errors, {:.2g} rows count as one"
NOMINAL_NOTE = (
    f"the data determine {{}} less well than to {LENGTH_TOLERANCE_M * 1e3:g} mm or "
    f"{ANGLE_TOLERANCE_RAD * 1e3:.3g} mrad: geometry is taken to lie within that of its nominal value (one σ)"
)


@dataclass(frozen=True, eq=False)
class FitSetup:
    """Which directions a calibration fits, and with what prior; decided once, at the nominal model.

    Args:
        identifiability: what the data alone determine.
        directions: (k, r) the steps that are fitted [rad or m].
        fixed: (k,) whether data, or stated σ's, determine the parameter.
        prior: of the fit, or ``None``.
        stated: (k,) the stated σ of each parameter that counts as knowledge; NaN where there is none.
        noise: standard deviation that weighs the prior, in units of the instrument's: the residuals', times √design.
        design: how many rows say as much as one alone would, as neighbouring postures err alike.
        held: (k, h) steps of a tolerance each that nothing determines: they are not fitted [rad or m].
        notes: sentences on what was assumed.
        widths: of parts by manufacturing.
    """

    identifiability: Identifiability
    directions: Array
    fixed: Mask
    prior: Prior | None
    stated: Array
    noise: float
    design: float
    held: Array
    notes: tuple[str, ...]
    widths: Widths

    @property
    def assumed(self) -> Array:
        """(k,) how far parts are uncertain by manufacturing alone [rad, m]; NaN where none is assumed."""
        return self.widths.uncertain


def determine_directions(
    problem: ProblemData, residuals: Residuals, x: Array, held: int | None, priors: bool,
    found: Fit | None = None, widths: Widths | None = None, noise: float = np.inf,
) -> FitSetup:  # fmt: skip
    """What measurements determine at the deviations ``x``, by themselves and with what is known beforehand.

    The noise is what no step of all parameters explains, but no less than the instrument's: what the model cannot
    express makes data worth less, and less still where neighbouring postures have it in common. Without stated σ's,
    geometry has the prior of 10 mm and 1°, or that of manufacturing, `assumed_widths`. With an estimate already
    ``found``, the noise is what that one leaves.

    Args:
        x: (k,) deviations [rad, m]; held: the parameter that is held as the size of the arm, or None.
        priors: whether stated σ's, and tolerances of the geometry, count as knowledge.
        widths: of parts by manufacturing, where the data have changed them.
        noise: the most that it is, in units of the instrument's: what effects leave that were found with the geometry.
    """
    parameters, rows = residuals.parameters, len(residuals.data)
    names = [p.name for p in parameters]
    J = residuals.residuals_and_jacobian(x)[1]
    spread, design = _noise_and_design(residuals, x, found)
    spread = min(spread * float(np.sqrt(design)), noise)
    indices, covariance = prior_covariance(problem, parameters) if priors else ([], np.zeros((0, 0)))
    scale = prior_tolerances(parameters, indices)
    nothing = np.full(len(names), np.nan)
    made = Widths(nothing, nothing)
    if priors:
        made = widths or assumed_widths(residuals, indices)
        weighing = _with_assumed(indices, covariance, scale, made.typical)[1]
        indices, covariance, scale = _with_assumed(indices, covariance, scale, made.uncertain)
    alone = identify_parameters(names, J, rows, held, scale=scale, noise=spread)
    stated = np.full(len(names), np.nan)
    stated[indices] = np.sqrt(np.diag(covariance))
    if not priors:
        rest = scale[:, None] * alone.null
        return FitSetup(
            alone,
            alone.directions,
            alone.determined,
            None,
            stated,
            spread,
            design,
            rest,
            _design_notes(design),
            made,
        )
    known = Prior.of(indices, covariance).matrix(len(names))
    both = (
        identify_parameters(names, np.concatenate([J / spread, known]), rows, held, scale=scale) if indices else alone
    )
    own = np.isfinite(made.uncertain)
    fixed = both.determined | (np.isfinite(stated) & (np.arange(len(names)) != (-1 if held is None else held)))
    fixed = np.where(own, both.alone < IMPROVED_SHARE * scale, fixed)
    prior = full_prior(parameters, problem.robot, scale, indices, covariance)
    if own.any():
        prior = full_prior(parameters, problem.robot, scale, indices, weighing).counted_as(prior)
    vague = both.hardly.shape[1] and not own.any()
    notes = (*_design_notes(design), *([NOMINAL_NOTE.format(_vague_names(both))] if vague else []))
    directions = np.concatenate([both.directions, both.hardly], axis=1)
    rest = scale[:, None] * both.vectors[:, directions.shape[1] :]
    return FitSetup(alone, directions, fixed, prior, stated, spread, design, rest, notes, made)


def _with_assumed(stated: list[int], covariance: Array, scale: Array, assumed: Array) -> tuple[list[int], Array, Array]:
    """Indices with a known σ, their covariance, and all tolerances, with the parameters that are ``assumed`` (k,)."""
    more = np.flatnonzero(np.isfinite(assumed)).tolist()
    wide = np.zeros((len(stated) + len(more),) * 2)
    wide[: len(stated), : len(stated)] = covariance
    wide[len(stated) :, len(stated) :] = np.diag(assumed[more] ** 2)
    return [*stated, *more], wide, np.where(np.isfinite(assumed), assumed, scale)


def unseen_errors_of_fit(residuals: Residuals, known: FitSetup, found: Fit, length: int | None) -> Array:
    """(k,) part of the standard errors that combinations leave which nothing determines [rad, m].

    What is held moves nothing at the nominal arm, but something at the fitted one: a tool of unknown length,
    on an axis found tilted, is displaced sideways, and the estimates make up for it. For steps H that are held, at D
    that are fitted, the estimate errs by ``H − D (AᵀA)⁻¹ (J D)ᵀ J H``, the normal equations' at the fitted arm.

    Args:
        length: the parameter that is held as the size of the arm, if there is one: all lengths are relative to it.
    """
    J = residuals.take(np.flatnonzero(found.kept)).residuals_and_jacobian(found.x)[1]
    if length is not None:
        J[:, length] = 0.0
    inverse = known.directions @ np.linalg.pinv(found.minimum.R, rcond=1e-14)
    moved = known.held - inverse @ (inverse.T @ (J.T @ (J @ known.held)))
    return np.asarray(np.linalg.norm(moved, axis=1))


def _noise_and_design(residuals: Residuals, x: Array, found: Fit | None) -> tuple[float, float]:
    """The residuals' standard deviation in units of the instrument's, at least 1, and their design effect."""
    if found is not None:
        residuals, x = residuals.take(np.flatnonzero(found.kept)), found.x
    r, J = residuals.residuals_and_jacobian(x)
    measured = len(residuals.data) * residuals.block
    r, J = r[:measured], J[:measured]
    if measured <= J.shape[1]:
        return 1.0, 1.0
    rest = unexplained_residuals(r, J)
    return max(robust_noise(r, J, residuals.block), 1.0), design_effect(residuals, rest, J)


def _design_notes(design: float) -> tuple[str, ...]:
    """A sentence where rows are fewer than they look; none at a design effect of 1."""
    return (DESIGN_NOTE.format(design),) if design > 1 else ()


def prior_tolerances(parameters: Sequence[Parameter], stated: list[int]) -> Array:
    """How far each unknown may be off beforehand [rad or m]: geometry, and frames of which a σ is stated, not far.

    Geometry: 10 mm and 1° (`LENGTH_TOLERANCE_M`, `ANGLE_TOLERANCE_RAD`); free frames and points 1 m and 1 rad.
    """
    part = {"m": LENGTH_TOLERANCE_M, "rad": ANGLE_TOLERANCE_RAD}
    return np.array(
        [
            part.get(p.unit, FREE_TOLERANCE) if p.made or i in stated else FREE_TOLERANCE
            for i, p in enumerate(parameters)
        ]
    )


def full_prior(
    parameters: Sequence[Parameter], robot: Robot, scale: Array, stated: list[int], covariance: Array
) -> Prior:
    """Stated σ's, for the rest of the geometry its tolerance, and for the offsets of free tools the arm's size.

    Args:
        scale: (k,) tolerances; stated: indices with a stated σ, whose covariance is ``covariance``.
    """
    sigma = np.where([offset_of_tool(p) for p in parameters], tool_sigma(robot), scale)
    rest = [i for i, p in enumerate(parameters) if (p.made or offset_of_tool(p)) and i not in stated]
    both = np.zeros((len(stated) + len(rest),) * 2)
    both[: len(stated), : len(stated)] = covariance
    both[len(stated) :, len(stated) :] = np.diag(sigma[rest] ** 2)
    return Prior.of([*stated, *rest], both)


def _vague_names(known: Identifiability) -> str:
    """The parameters that have the largest parts in what is hardly determined."""
    parts = np.abs(known.hardly / known.scale[:, None]).max(axis=1)
    most = [int(i) for i in np.argsort(-parts, kind="stable") if parts[i] > 0.3 * parts.max()][:4]
    return enumerated(known.names[i] for i in most)
