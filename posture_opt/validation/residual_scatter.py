"""What a calibration leaves of the errors, as scatter of the joints from repeat to repeat."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.instrument import position_sigma
from posture_opt.calibration.parameters import CalibrationProblem
from posture_opt.calibration.residuals import Residuals
from posture_opt.errors import InsufficientDataError
from posture_opt.model.effects import NoiseEffect
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.validation.joint_variances import JointVariances, estimate_joint_variances
from posture_opt.validation.prediction import (
    JointScatter,
    calibrated_prediction,
    joint_columns,
    joint_errors,
    plus,
    scatter_beside,
    scatter_of_effects,
    stated_scatter,
)

_TAUGHT = 0.8  # of the rows taught the arm that predicts a row: five folds
_LEVER = 0.1  # of the longest of a turning joint
_EXACT = 0.3  # of the instrument's standard deviation
_SURE = 0.5  # of a standard deviation: with a larger standard error the data do not tell it


def residual_scatter(
    problem: CalibrationProblem, calibration: Calibration, named: Sequence[NoiseEffect] = ()
) -> JointScatter:
    """The joints' scatter that explains best what a calibration and the instrument leave unexplained.

    It is sought in the errors of rows by arms that have not seen them: scatter from repeat to repeat and whatever the
    model lacks, both to be met again at the next repeat, beside the uncertainty of the fit, which is known. One
    standard deviation for all turning joints is taken unless the likelihood speaks clearly for one each (Schwarz 1978).

    Where the data cannot tell the scatter from none, and do not speak against it, the problem's own is returned: its
    repeatability, the σ's of its joints, or what the robot's data sheet says.

    The noise of a joint that effects of the problem speak of, or the effects ``named`` in these data, is known: it is
    that of the effects and what the problem states beside them, and is not sought again.
    """
    own, stated = scatter_of_effects(problem.robot, problem.effects), stated_scatter(problem)
    said = scatter_of_effects(problem.robot, [*problem.effects, *named])
    stated = _with_effects(stated, said)
    fixed = {name: scatter_beside(problem, name, own.get(name, 0.0), s) for name, s in said.items()}
    if set(joint_errors(problem.robot)) <= set(fixed):
        note, instrument = "effects say all scatter of the joints", position_sigma(problem, calibration.residuals.data)
        sigma = {name: s for name, s in fixed.items() if s > 0}
        return _with_effects(JointScatter(sigma, instrument, True, note), said, added=False)
    found = _from_data(problem, calibration, fixed)
    if found is None:
        return stated
    noise, given = found
    if stated.sigma and _does_not_tell(noise, stated.sigma):
        return stated
    sigma = {name: float(s) for name, s in zip(noise.names, noise.sigma, strict=True) if s > 0} | fixed
    if not sigma:
        return JointScatter({}, noise.instrument, True, "no scatter of the joints is seen behind the instrument's")
    source = (
        "the instrument as stated" if given else f"the instrument, {noise.instrument * 1e3:.3g} mm, from the data too"
    )
    note = f"scatter of the joints from what the calibration leaves of the errors ({source})"
    return _with_effects(JointScatter(sigma, noise.instrument, True, note), said, added=False)


def _with_effects(scatter: JointScatter, said: Mapping[str, float], added: bool = True) -> JointScatter:
    """The scatter with the part that effects say, ``added`` unless it is in it, told in the note."""
    if not said:
        return scatter
    note = f"{scatter.note}; that of {', '.join(said)} stands under effects"
    return replace(scatter, sigma=plus(scatter.sigma, said) if added else scatter.sigma, of_effects=said, note=note)


def unseen_errors(calibration: Calibration) -> tuple[Array, Array, Codes]:
    """Errors (m, d) [m] of the kept rows by arms that have not seen them, their known part, and the rows.

    The known part (m, d, d) [m²] is what the fits' own uncertainty adds: near a singular posture the joints hardly
    scatter along the arm, and all that is left there would be laid on them.
    """
    residuals = calibration.residuals
    rows = calibration.kept_rows
    kept = residuals.take(rows)
    none = np.zeros(residuals.robot.n)
    known = calibrated_prediction(kept, calibration.x, calibration.covariance, none, 0.0, _TAUGHT).covariance
    return calibration.errors[np.ix_(rows, kept.axes)], known, rows


def _from_data(
    problem: CalibrationProblem, calibration: Calibration, fixed: Mapping[str, float]
) -> tuple[JointVariances, bool] | None:
    """The likeliest scatter of the joints whose own is not ``fixed``, and whether the instrument's was given.

    ``None`` where the data do not tell it.
    """
    errors, known, rows = unseen_errors(calibration)
    columns, names = joint_columns(calibration.residuals.take(rows), calibration.x), joint_errors(problem.robot)
    still = np.array([name in fixed for name in names])
    loud = columns[:, :, still] * np.array([fixed[name] for name in names if name in fixed])
    known = known + loud @ np.swapaxes(loud, -1, -2)
    columns, names = columns[:, :, ~still], tuple(name for name in names if name not in fixed)
    stated = position_sigma(problem, calibration.residuals.data)
    size = float(np.sqrt(np.mean(errors**2)))
    if size <= _EXACT * stated or not size > 0:
        return None  # better than their instrument: made up, or the instrument is another one
    if stated:
        noise = _likeliest(errors, known, columns, names, stated, fit=False)
        return (noise, True) if noise is not None else None
    noise = _likeliest(errors, known, columns, names, size, fit=True)
    if noise is None or not noise.sigma.any() or not noise.instrument_std < _SURE * noise.instrument:
        # Nobody says how good the instrument is, and the data do not tell it from the joints: all of it is theirs.
        noise = _likeliest(errors, known, columns, names, 0.0, fit=False)
    return (noise, False) if noise is not None else None


def covariance_under(calibration: Calibration, scatter: JointScatter, without: Codes | None = None) -> Array:
    """(k, k) covariance of the estimate ``x``, given the errors that the joints and the instrument make in each row.

    Least squares weighs all coordinates alike, and its own covariance ``s² A``, ``A = (JᵀJ + s² P)⁻¹`` with the prior's
    precision P, takes them to be alike. The joints scatter the tool point more where the arm is stretched:

    ``A (Σ J_iᵀ V_i J_i) A + s² (A − A JᵀJ A)``,  ``V_i = s_0² I + J_q diag(σ²) J_qᵀ``.

    ``without`` are rows that are not to count; A without them is ``A + A J_wᵀ (I − J_w A J_wᵀ)⁻¹ J_w A``.

    Source: White (1980), equation 5, with modelled variances and a prior.
    """
    residuals, s2 = calibration.residuals, calibration.variance
    if calibration.design > 1 or not s2 > 0:
        return calibration.covariance  # sums over blocks of rows hold what each row makes of it
    left_out = np.zeros(0, dtype=np.intp) if without is None else without
    A = _without(calibration.covariance / s2, residuals.take(left_out), calibration.x)
    if not scatter.measured or residuals.oriented or residuals.distances:
        return s2 * A
    rows = np.setdiff1d(calibration.kept_rows, left_out)
    kept = residuals.take(rows)
    n, d = len(rows), len(kept.axes)
    J = kept.both(calibration.x)[1][: n * d]
    sigma = np.array([scatter.sigma.get(name, 0.0) for name in joint_errors(residuals.robot)])
    S = joint_columns(kept, calibration.x) * sigma / kept.sigma
    weighed = np.einsum("nij,nik->njk", S, J.reshape(n, d, -1))
    meat = (scatter.instrument / kept.sigma) ** 2 * J.T @ J + np.einsum("njk,njl->kl", weighed, weighed)
    found = A @ meat @ A + s2 * (A - A @ (J.T @ J) @ A)
    return np.asarray((found + found.T) / 2)


def _without(A: Array, rows: Residuals, x: Array) -> Array:
    """The inverse ``A`` (k, k) of the normal equations without some rows."""
    n = len(rows.data) * rows.block
    if not n:
        return A
    JA = rows.both(x)[1][:n] @ A
    inner = np.eye(n) * (1 + 1e-9) - JA @ rows.both(x)[1][:n].T
    return np.asarray(A + JA.T @ np.linalg.solve(inner, JA))


def _likeliest(
    errors: Array, known: Array, columns: Array, names: tuple[str, ...], instrument: float, *, fit: bool
) -> JointVariances | None:
    try:
        common = estimate_joint_variances(
            errors, columns, instrument=instrument, fit_instrument=fit, equal=True, names=names, known=known
        )
    except InsufficientDataError:
        return None
    if not common.determined.all():
        return None
    strong = _strong(columns, names)
    turning = sum(not name.endswith(".d") for name, own in zip(names, strong, strict=True) if own)
    if turning < 2:
        return common
    weak = columns[:, :, ~strong] * common.sigma[~strong]
    beside = known + weak @ np.swapaxes(weak, -1, -2)
    own = [name for name, s in zip(names, strong, strict=True) if s]
    try:
        each = estimate_joint_variances(
            errors, columns[:, :, strong], instrument=instrument, fit_instrument=fit, names=own, known=beside
        )
    except InsufficientDataError:
        return common
    clear = 2 * (each.log_likelihood - common.log_likelihood) > (turning - 1) * math.log(errors.size)
    if not (clear and each.determined.all()):
        return common
    sigma, std, interval = common.sigma.copy(), common.std.copy(), common.interval.copy()
    sigma[strong], std[strong], interval[strong] = _allowed(each), each.std, each.interval
    return replace(each, names=names, sigma=sigma, std=std, interval=interval)


def _allowed(noise: JointVariances) -> Array:
    """(n,) σ's to predict with: where the data allow none, half of the most that they allow.

    That is the root mean square of a half normal whose 95 % end it is. A likeliest σ of zero would predict a region
    without thickness, and little data find one often.
    """
    low, high = noise.interval.T
    return np.where((low <= 0) & np.isfinite(high), np.maximum(noise.sigma, high / 2), noise.sigma)


def _strong(columns: Array, names: tuple[str, ...]) -> Mask:
    """(n,) which joints move what was measured far enough to have a σ of their own.

    The last joint of an arm turns the tool point a little about itself: asked alone, it would have to swing by degrees
    to explain what others leave.
    """
    lever = np.sqrt(np.mean(np.sum(columns**2, axis=1), axis=0))
    turning = np.array([not name.endswith(".d") for name in names])
    return np.asarray(~turning | (lever > _LEVER * lever[turning].max(initial=0.0)))


def _does_not_tell(noise: JointVariances, stated: Mapping[str, float]) -> bool:
    """Whether all standard deviations may be zero as well as those that are stated."""
    nothing = not noise.interval[:, 0].any()
    upper = dict(zip(noise.names, noise.interval[:, 1], strict=True))
    return nothing and all(sigma <= upper.get(name, math.inf) for name, sigma in stated.items())
