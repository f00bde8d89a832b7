"""What a calibration leaves of the errors: scatter of the joints from repeat to repeat, and what stays at a posture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.repeats import MIN_FREEDOM, Contrasts
from posture_opt.model.effects import NoiseEffect
from posture_opt.numerics import Array, Codes, rms
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.repeatability import joint_sigmas
from posture_opt.validation.joint_variances import JointVariances, likeliest_variances
from posture_opt.validation.prediction import (
    JointScatter,
    added_in_quadrature,
    calibrated_prediction,
    joint_columns,
    joint_errors,
    prismatic_joints,
    scatter_of_effects,
    scatter_with_effects,
    stated_scatter,
    symmetric_root,
)


@dataclass(frozen=True)
class ScatterLimit:
    """The most that the joints' errors scatter from repeat to repeat."""

    sigma: Mapping[str, float]  # JOINT.theta or JOINT.d -> standard deviation [rad or m]
    source: str  # a clause on where it is from
    shown: bool = False  # whether repeats show so much, and not only allow it


def scatter_limit(
    problem: ProblemData, calibration: Calibration, fixed: Mapping[str, float], fitted: Array | None = None
) -> ScatterLimit | None:
    """The limit by repeats where there are enough, else by the file's scatter or the data sheet (ISO 9283).

    fixed: σ of joints that is known already. fitted: (m, d) errors of the kept rows by the arm fitted to all of them
    [m]; the calibration's by default.
    """
    kept = calibration.residuals.take(calibration.kept_rows)
    contrasts, names = Contrasts.of(kept.data, prismatic_joints(kept)), joint_errors(problem.robot)
    errors = kept.error(calibration.x)[:, kept.axes] if fitted is None else fitted
    # Contrasts have the variance of several readings: scaled to that of one.
    scale = 1 / np.sqrt(contrasts.reading)
    e = contrasts.differences(errors) * scale[:, None]
    stated, sought = position_sigma(problem, kept.data), [name for name in names if name not in fixed]
    if len(contrasts) * len(kept.axes) >= MIN_FREEDOM and rms(e) > 0 and sought:
        columns = contrasts.means(joint_columns(kept, calibration.x)) * scale[:, None, None]
        loud = columns * np.array([fixed.get(name, 0.0) for name in names])
        own, known = columns[:, :, [name in sought for name in names]], loud @ np.swapaxes(loud, -1, -2)
        noise = likeliest_variances(e, known, own, tuple(sought), stated or rms(e), fit=not stated)
        if noise is not None:
            sigma = dict(zip(noise.names, map(float, noise.sigma), strict=True))
            return ScatterLimit(sigma | dict(fixed), f"as {len(contrasts)} differences between repeats show it", True)
    sources, sheet = problem.sources, problem.robot.repeatability
    total = dict(zip(sources.names, map(float, np.sqrt(np.diag(sources.scatter))), strict=True))
    said = {name: s for name, s in total.items() if s > 0}
    if said:
        return ScatterLimit(said, "as the file states it")
    if sheet is None:
        return None
    found = joint_sigmas(problem.robot, sheet.value)
    sigma = dict(zip(found.names, map(float, found.sigma), strict=True))
    return ScatterLimit(sigma, "as the data sheet allows")


def residual_scatter(
    problem: ProblemData, calibration: Calibration, named: Sequence[NoiseEffect] = (), fitted: Array | None = None
) -> JointScatter:
    """The joints' scatter that explains best what a calibration and the instrument leave unexplained.

    It is sought in the errors of rows by arms that have not seen them: scatter from repeat to repeat and whatever the
    model lacks, both to be met again at the next posture, in addition to the uncertainty of the fit, which is known.
    One standard deviation for all turning joints is taken unless the likelihood speaks clearly for one each (Schwarz
    1978). What of it exceeds the limit that repeats show, else the file or the data sheet states, is no scatter: the
    model errs by that much, alike at every repeat (``staying``). Where nothing shows a limit, all of it is an upper
    bound.
    """
    own, stated = scatter_of_effects(problem.robot, problem.effects), stated_scatter(problem)
    said = scatter_of_effects(problem.robot, [*problem.effects, *named])
    stated = _with_effects(stated, said)
    fixed = {name: scatter_with_effects(problem, name, own.get(name, 0.0), s) for name, s in said.items()}
    if set(joint_errors(problem.robot)) <= set(fixed):
        note, instrument = "no scatter of joints is left to find", position_sigma(problem, calibration.residuals.data)
        sigma = {name: s for name, s in fixed.items() if s > 0}
        return _with_effects(JointScatter(sigma, instrument, True, note), said, added=False)
    noise, given = _from_data(problem, calibration, fixed)
    if noise is None:
        return stated
    upper = dict(zip(noise.names, noise.interval[:, 1], strict=True))
    compatible = all(sigma <= upper.get(name, math.inf) for name, sigma in stated.sigma.items())
    if stated.sigma and compatible and not noise.interval[:, 0].any():
        return stated
    sigma = {name: float(s) for name, s in zip(noise.names, noise.sigma, strict=True) if s > 0} | fixed
    if not sigma:
        return JointScatter({}, noise.instrument, True, "no scatter of the joints is seen behind the instrument's")
    source = "the instrument as stated"
    if not given:
        source = f"the instrument, {noise.instrument * 1e3:.3g} mm, from the data too"
    limit = scatter_limit(problem, calibration, fixed, fitted)
    total = JointScatter(sigma, noise.instrument, True, f"what the calibration leaves of the errors ({source})")
    return _with_effects(_split_scatter(total, fixed, limit), said, added=False)


def _split_scatter(total: JointScatter, fixed: Mapping[str, float], limit: ScatterLimit | None) -> JointScatter:
    if limit is None:
        bound = "an upper bound, as repeats are too few to separate it from errors of the model"
        return replace(total, note=f"scatter of the joints from {total.note}: {bound}")
    least = {name: s for name, s in limit.sigma.items() if s > 0} if limit.shown else {}
    sigma = {n: max(total.sigma.get(n, 0.0), least.get(n, 0.0)) for n in dict.fromkeys((*total.sigma, *least))}
    excess = {n: s**2 - limit.sigma.get(n, 0.0) ** 2 for n, s in sigma.items() if n not in fixed}
    staying = {name: math.sqrt(variance) for name, variance in excess.items() if variance > 0}
    note = f"scatter of the joints {limit.source}"
    if staying:
        note += "; errors of the model beyond it are the same at every repeat, and are listed with what is uncertain"
    return replace(total, sigma=sigma, staying=staying, note=note)


def _with_effects(scatter: JointScatter, said: Mapping[str, float], added: bool = True) -> JointScatter:
    if not said:
        return scatter
    note = f"{scatter.note}; that of {', '.join(said)} is listed under effects"
    sigma = added_in_quadrature(scatter.sigma, said) if added else scatter.sigma
    return replace(scatter, sigma=sigma, of_effects=said, note=note)


def unseen_errors(calibration: Calibration) -> tuple[Array, Array, Codes]:
    """Errors (m, d) [m] of the kept rows by arms that have not seen them, their known part, and the rows.

    The known part (m, d, d) [m²] is what the fits' own uncertainty adds: near a singular posture the joints hardly
    scatter along the arm, and all that is left there would be laid on them.
    """
    residuals = calibration.residuals
    rows = calibration.kept_rows
    kept = residuals.take(rows)
    none = np.zeros(residuals.robot.n)
    # 0.8 of the rows taught the arm that predicts a row: five folds
    known = calibrated_prediction(kept, calibration.x, calibration.covariance, none, 0.0, 0.8).covariance
    return calibration.errors[np.ix_(rows, kept.axes)], known, rows


def _from_data(
    problem: ProblemData, calibration: Calibration, fixed: Mapping[str, float]
) -> tuple[JointVariances | None, bool]:
    """The likeliest scatter of the joints whose own is not ``fixed``, and whether the instrument's was given."""
    errors, known, rows = unseen_errors(calibration)
    columns, names = joint_columns(calibration.residuals.take(rows), calibration.x), joint_errors(problem.robot)
    still = np.array([name in fixed for name in names])
    loud = columns[:, :, still] * np.array([fixed[name] for name in names if name in fixed])
    known = known + loud @ np.swapaxes(loud, -1, -2)
    columns, names = columns[:, :, ~still], tuple(name for name in names if name not in fixed)
    stated, size = position_sigma(problem, calibration.residuals.data), rms(errors)
    # Below 0.3 of its σ data are better than their instrument: made up, or the instrument is another one.
    if size <= 0.3 * stated or not size > 0:
        return None, bool(stated)
    noise = likeliest_variances(errors, known, columns, names, stated or size, fit=not stated)
    if not stated and (noise is None or not noise.sigma.any() or not noise.instrument_std < 0.5 * noise.instrument):
        # The instrument's σ is not stated, and the data do not separate it from the joints: all of it is theirs.
        noise = likeliest_variances(errors, known, columns, names, 0.0, fit=False)
    return noise, bool(stated)


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
    A = _inverse_without_rows(calibration.covariance / s2, residuals.take(left_out), calibration.x)
    if not scatter.measured or residuals.data.kind.further or residuals.distances or residuals.place_sigmas:
        return s2 * A
    rows = np.setdiff1d(calibration.kept_rows, left_out)
    kept = residuals.take(rows)
    n, d = len(rows), len(kept.axes)
    J = kept.residuals_and_jacobian(calibration.x)[1][: n * d]
    sigma = np.array([scatter.sigma.get(name, 0.0) for name in joint_errors(residuals.robot)])
    S = joint_columns(kept, calibration.x) * sigma / kept.sigma
    weighed = np.einsum("nij,nik->njk", S, J.reshape(n, d, -1))
    meat = (scatter.instrument / kept.sigma) ** 2 * J.T @ J + np.einsum("njk,njl->kl", weighed, weighed)
    found = A @ meat @ A + s2 * (A - A @ (J.T @ J) @ A)
    return np.asarray((found + found.T) / 2)


def _inverse_without_rows(A: Array, rows: Residuals, x: Array) -> Array:
    """The inverse ``A`` (k, k) of the normal equations without some rows.

    ``A + A Jᵀ (I − J A Jᵀ)⁻¹ J A = S (I − G)⁻¹ Sᵀ`` with ``A = S Sᵀ`` and ``G = Sᵀ JᵀJ S``: as large as the unknowns,
    whatever the number of rows.
    """
    n = len(rows.data) * rows.block
    if not n:
        return A
    S = symmetric_root(A)
    reduced = rows.residuals_and_jacobian(x)[1][:n] @ S
    G = reduced.T @ reduced
    added = np.linalg.solve(np.eye(len(G)) * (1 + 1e-9) - G, G)  # a direction that no other row sees stays finite
    return np.asarray(A + S @ ((added + added.T) / 2) @ S.T)
