"""The kinds of noise that a diagnosis names, once every other cause is taken away."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma, relative_sigma
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.diagnosis.noise.noise_candidates import (
    GROSS_ERRORS,
    fit_tails,
    score_stated_sigma,
    standardised_residuals,
)
from posture_opt.diagnosis.noise.uneven_noise import NoiseCause, NoiseSample, UnevenErrors, find_uneven_noise
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.score_tests import ProjectedBaseline
from posture_opt.measurements.repeats import Contrasts, repeat_of_row
from posture_opt.model.effects import Outliers, Rows
from posture_opt.numerics import Array
from posture_opt.selection.problem_data import ProblemData
from posture_opt.validation.prediction import joint_errors
from posture_opt.validation.repeat_scatter import prismatic_joints
from posture_opt.validation.scatter_model import whitened_repeats


def noise_causes(
    problem: ProblemData,
    calibration: Calibration,
    model: Fit,
    baseline: ProjectedBaseline,
    adequacy: float,
    seed: int,
) -> tuple[list[NoiseCause], list[UnevenErrors]]:
    """Noisy joints or noise that grows with the range; gross outliers; a stated σ that is wrong.

    The second list holds errors that look like a noisy joint, and that repeats do not show to be one.

    A stated σ is tested only where no other noise was found and nothing is left unexplained: structure and a noisy
    joint swell residuals too. Gross errors are sought among all rows, those too that the calibration left out.

    Args:
        adequacy: p-value of the tests for anything left unexplained, 0 where an unnamed component is.
        problem: for what it states of instrument and joints.
        model: the arm with its effects; ``baseline`` everything that was fitted, unnamed components too.
        seed: of the null distributions.
    """
    everything, repeats, whole = noise_samples(problem, model.residuals, baseline, _joint_columns(model))
    level = levels.FURTHER_NOISE_LEVEL if model.effects else levels.NOISE_LEVEL
    found, uneven = find_uneven_noise(everything, repeats, seed, level)
    other = bool(found or uneven)
    found += [] if adequacy < levels.LACK_OF_FIT_LEVEL else _outlier_causes(calibration, model, other)
    if position_sigma(problem, model.residuals.data) and not (found or uneven) and adequacy >= levels.STRUCTURE_LEVEL:
        squares = everything.e**2
        kurtosis = float(np.mean(squares**2) / np.mean(squares) ** 2 - 3)
        # Standardised residuals have their leverage back already.
        variance = float(np.mean(squares)) if whole else float(baseline.rss[0]) / baseline.freedom
        estimated = None if problem.measurement is None else problem.measurement.degrees_of_freedom
        candidate = score_stated_sigma(variance, baseline.freedom, kurtosis, estimated)
        if candidate.p_value < levels.NOISE_LEVEL and abs(np.log(candidate.size)) > np.log(levels.STATED_SIGMA_RATIO):
            found.append(NoiseCause(candidate.named(), candidate.estimate, candidate.p_value))
    return found, uneven


def noise_samples(
    problem: ProblemData, residuals: Residuals, baseline: ProjectedBaseline, columns: Array
) -> tuple[NoiseSample, NoiseSample, bool]:
    """The residuals of all rows, and the contrasts of repeats, in units of what the file states of their scatter.

    Contrasts have lost no freedom to the fit, which errs alike at every repeat: no leverage is given back to them. The
    last of the three is that of `in_stated_units`.

    Args:
        columns: (n, N, block) whitened residual per unit of each joint.
    """
    m, block, data = residuals.measured, residuals.block, residuals.data
    Q = baseline.Q[:m].reshape(-1, block, baseline.Q.shape[1])
    raw = baseline.e[:m].reshape(-1, block)
    e, levers, whole = in_stated_units(
        problem, residuals, standardised_residuals(raw, Q @ np.swapaxes(Q, 1, 2)), columns
    )
    rows = Rows(residuals.robot, levers, _instrument_ranges(residuals), residuals.sigma, repeat_of_row(data))
    plain = NoiseSample(in_stated_units(problem, residuals, raw, columns)[0], rows)
    return NoiseSample(e, rows), plain.between(Contrasts.of(data, prismatic_joints(residuals))), whole


def noise_shape(model: Fit, causes: Sequence[NoiseCause]) -> Array | None:
    """Covariance (N, axes, axes) of positions that named noise gives the rows, up to a factor.

    None where it is the same.
    """
    residuals = model.residuals
    columns = _joint_columns(model)[:, :, : len(residuals.axes)]
    rows = Rows(residuals.robot, columns, _instrument_ranges(residuals), residuals.sigma)
    shapes = [shape for cause in causes if (shape := cause.effect.shape(rows)) is not None]
    one = np.eye(columns.shape[2])
    return np.asarray(one + sum(shape - one for shape in shapes)) if shapes else None


def _joint_columns(model: Fit) -> Array:
    """Whitened residuals (n, N, block) per unit of each joint value."""
    return np.moveaxis(model.residuals.sensitivities(model.residuals.robot.driven, model.x), -1, 0)


def _instrument_ranges(residuals: Residuals) -> Array | None:
    """Distances (N,) of the measured points from the instrument at the world's origin [m]; None of touched points."""
    position = residuals.data.position
    return None if position is None else np.asarray(np.linalg.norm(position, axis=1))


def in_stated_units(
    problem: ProblemData, residuals: Residuals, e: Array, columns: Array
) -> tuple[Array, Array, bool]:  # fmt: skip
    """Residuals (N, d) and joint columns (n, N, d) in units of what instrument and joints should scatter by.

    The last of the three says whether the file states a scatter of the joints from repeat to repeat, or an instrument
    that is not the same everywhere; without either everything stays as it is, in units of the instrument's σ.

    ``L⁻¹ e`` with ``L Lᵀ = D + J diag(σ²) Jᵀ`` of all rows of a repeat, D the instrument's variances: the null
    distribution then knows the scatter that is stated.
    """
    sources, own = problem.sources, relative_sigma(problem, residuals.data)
    at = {name: i for i, name in enumerate(sources.names)}
    variance = np.diag(sources.scatter)
    sigma = np.array([np.sqrt(variance[at[name]]) if name in at else 0.0 for name in joint_errors(problem.robot)])
    if not sigma.any() and np.all(own == 1.0):
        return e, columns, False
    S = np.moveaxis(columns, 0, 2) * sigma
    instrument = np.ones(e.shape)
    instrument[:, : len(residuals.axes)] = own[:, None] ** 2
    return *whitened_repeats(e, columns, S, repeat_of_row(residuals.data), instrument), True


def _outlier_causes(calibration: Calibration, model: Fit, other: bool) -> list[NoiseCause]:
    """Gross errors among all rows, where a few of them explain the tails better than a long-tailed law."""
    if not calibration.outliers or other:
        return []
    residuals = calibration.residuals
    everyone = model.residuals.of_data(residuals.data, residuals.distances)
    e = everyone.whitened(model.x)[: everyone.measured].reshape(-1, residuals.block)
    law = fit_tails(e)
    if law.shape != GROSS_ERRORS:
        return []
    count = int(law.rows.sum())
    p = float(np.exp(-max(law.evidence, 0.0) / 2))
    if p > levels.NOISE_LEVEL:
        return []
    share = Outliers(share=count / len(law.rows))
    return [NoiseCause(share, {"count": (float(count), float("nan"), "1")}, p)]
