"""What a calibration leaves of the errors, as scatter of the joints from visit to visit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from posture_opt.diagnosis.calibration import Calibration
from posture_opt.diagnosis.joint_noise import JointNoise, estimate_joint_noise
from posture_opt.diagnosis.parameters import CalibrationProblem
from posture_opt.errors import InsufficientDataError
from posture_opt.model.derivatives import position_column
from posture_opt.robot.robot import Robot

Array = NDArray[np.float64]

_LEAST = 0.02  # of the variance of a coordinate that the estimate leaves free: below, its residual says nothing
_SURE = 0.5  # of a standard deviation: with a larger standard error the data do not tell it


@dataclass(frozen=True)
class RemainingScatter:
    """Standard deviations of the joints' errors from visit to visit.

    Args:
        sigma: JOINT.theta or JOINT.d -> standard deviation [rad or m], above 0.
        instrument: standard deviation of a measured coordinate [m] that was taken off before.
        measured: whether the data say so; else it is what the problem file states.
        note: a sentence on where it comes from.
    """

    sigma: Mapping[str, float] = field(default_factory=dict)
    instrument: float = 0.0
    measured: bool = False
    note: str = ""


def remaining_scatter(problem: CalibrationProblem, calibration: Calibration) -> RemainingScatter:
    """The joints' scatter that explains best what a calibration and the instrument leave unexplained.

    The residuals ``e_i`` of the fit are smaller than the errors of rows that it has not seen; with
    ``H = J (JᵀJ)⁻¹ Jᵀ`` the corrected ``(I − H_ii)^(−½) e_i`` have the size of the true errors. They hold the scatter
    from visit to visit and whatever the model lacks, both to be met again at the next visit. One standard deviation
    for all turning joints is taken unless the likelihood speaks clearly for one each (Schwarz 1978).

    Where the data cannot tell, the problem's own scatter is returned: its repeatability, or the σ's of its joints.
    """
    found = _from_data(problem, calibration)
    if found is None:
        return _stated(problem)
    noise, given = found
    sigma = {name: float(s) for name, s in zip(noise.names, noise.sigma, strict=True) if s > 0}
    source = (
        "the instrument as stated" if given else f"the instrument, {noise.instrument * 1e3:.3g} mm, from the data too"
    )
    note = f"scatter of the joints from what the calibration leaves of the errors ({source})"
    return RemainingScatter(sigma, noise.instrument, True, note)


def corrected_errors(calibration: Calibration) -> tuple[Array, NDArray[np.intp]]:
    """Position errors (m, d) [m] of the kept rows in the measured coordinates, corrected for the fit; and the rows."""
    residuals = calibration.residuals
    rows = np.setdiff1d(np.arange(len(residuals.data)), calibration.outliers)
    kept = residuals.take(rows)
    d, block, n = len(kept.axes), kept.block, len(rows)
    r, J = kept.both(calibration.x)
    e = r[: n * block].reshape(n, block)[:, :d] * kept.sigma
    blocks = J[: n * block].reshape(n, block, -1)[:, :d]
    if not calibration.variance > 0:
        return e, rows
    leverage = blocks @ calibration.covariance @ np.swapaxes(blocks, -1, -2) / calibration.variance
    values, vectors = np.linalg.eigh(np.eye(d) - leverage)
    scale = 1 / np.sqrt(np.maximum(values, _LEAST))
    return np.einsum("nij,nj,nkj,nk->ni", vectors, scale, vectors, e), rows


def _from_data(problem: CalibrationProblem, calibration: Calibration) -> tuple[JointNoise, bool] | None:
    """The likeliest scatter, and whether the instrument's was given; ``None`` where the data do not tell it."""
    errors, rows = corrected_errors(calibration)
    if not float(np.sum(errors**2)) > 0:
        return None
    columns, names = _joint_columns(calibration, rows)
    stated = problem.measurement.position if problem.measurement is not None else 0.0
    if stated:
        noise = _likeliest(errors, columns, names, stated, fit=False)
        return (noise, True) if noise is not None and noise.sigma.any() else None
    noise = _likeliest(errors, columns, names, float(np.sqrt(np.mean(errors**2))), fit=True)
    if noise is None or not noise.sigma.any() or not noise.instrument_std < _SURE * noise.instrument:
        # Nobody says how good the instrument is, and the data do not tell it from the joints: all of it is theirs.
        noise = _likeliest(errors, columns, names, 0.0, fit=False)
    return (noise, False) if noise is not None else None


def _joint_columns(calibration: Calibration, rows: NDArray[np.intp]) -> tuple[Array, tuple[str, ...]]:
    residuals = calibration.residuals.take(rows)
    robot = residuals.robot
    reached = residuals.walk(calibration.x)
    columns = np.zeros((len(rows), len(residuals.axes), robot.n))
    for k, factor in enumerate(robot.driven):
        column = position_column(reached, factor)
        for slot, axis in enumerate(residuals.axes):
            columns[:, slot, k] = column[axis]
    return columns, joint_errors(robot)


def joint_errors(robot: Robot) -> tuple[str, ...]:
    """(n,) the names of the joint values' errors, JOINT.theta or JOINT.d."""
    factors = robot.factors
    return tuple(factors[i].parameter for i in robot.driven)


def _likeliest(
    errors: Array, columns: Array, names: tuple[str, ...], instrument: float, *, fit: bool
) -> JointNoise | None:
    try:
        common = estimate_joint_noise(
            errors, columns, instrument=instrument, fit_instrument=fit, equal=True, names=names
        )
    except InsufficientDataError:
        return None
    if not common.determined.all():
        return None
    turning = sum(not name.endswith(".d") for name in names)
    if turning < 2:
        return common
    try:
        each = estimate_joint_noise(errors, columns, instrument=instrument, fit_instrument=fit, names=names)
    except InsufficientDataError:
        return common
    clear = 2 * (each.log_likelihood - common.log_likelihood) > (turning - 1) * math.log(errors.size)
    return each if clear and each.determined.all() else common


def _stated(problem: CalibrationProblem) -> RemainingScatter:
    sources = problem.sources
    visit = {name: float(s) for name, s in zip(sources.names, np.sqrt(np.diag(sources.visit)), strict=True) if s > 0}
    if visit:
        return RemainingScatter(visit, note="scatter of the joints as stated: the data do not tell it")
    own = joint_errors(problem.robot)
    sigma = {name: float(s) for name, s in zip(sources.names, sources.sigma, strict=True) if name in own and s > 0}
    note = "the σ's of the joints, as stated, taken for their scatter: the data do not tell it"
    return RemainingScatter(sigma, note=note if sigma else "the data tell no scatter of the joints, and none is stated")
