"""``diagnose``: from measurements to the causes of an arm's errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from posture_opt.calibration.calibrate import calibrate
from posture_opt.calibration.cross_validation import HeldOut, held_out
from posture_opt.calibration.doubts import doubts_about, free_directions, without_copies
from posture_opt.calibration.estimation.error_statistics import By, Statistics
from posture_opt.calibration.estimation.fit import Fit, fit_with_effects
from posture_opt.calibration.estimation.fit_request import FitRequest, Stages
from posture_opt.calibration.estimation.parameters import prior_covariance
from posture_opt.calibration.second_file import LargeFile
from posture_opt.diagnosis.causes.causes import (
    Finding,
    contradiction_findings,
    effect_findings,
    noise_finding,
    with_plausibility,
)
from posture_opt.diagnosis.causes.delivered_arm import Delivery, deliver_arm, nearer_to, outlasts_session
from posture_opt.diagnosis.causes.geometry_causes import Estimated, geometry_causes
from posture_opt.diagnosis.causes.sessions import second_session, three_models
from posture_opt.diagnosis.diagnosis import Diagnosis
from posture_opt.diagnosis.explained import Explained, explain_calibration, groups_and_folds
from posture_opt.diagnosis.noise.noise_causes import noise_shape
from posture_opt.diagnosis.scores import levels
from posture_opt.interrupts import interruptible
from posture_opt.limits import MOST_SEARCHED
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import thin
from posture_opt.model.effects import Effect
from posture_opt.numerics import Codes, Progress, rms
from posture_opt.selection.problem_data import ProblemData


@interruptible()
def diagnose(
    problem: ProblemData,
    data: Measurements,
    *,
    folds: int = 5,
    by: By | None = None,
    flips: int | None = None,
    seed: int | None = None,
    test: Measurements | None = None,
    refit_frames: bool = False,
    with_time: bool = False,
    plan: bool = True,
    most_rows: int = levels.MAX_SEARCHED_ROWS,
    progress: Progress | None = None,
) -> Diagnosis:
    """Name what the model lacks to explain measurements, at 5 % false alarms for the whole verdict.

    With whitened residuals r, geometry columns G and candidate columns Z the model is ``r = G x + Z θ + noise``.
    Candidates are chosen by an orthogonal matching pursuit, dropped by F tests, and as many are kept as predict rows
    that each fold left out. Then the noise, what is left, and the geometry are tested. Hundreds of rows take seconds.

    Geometry that the data determine is part of every model. Effects and unnamed components compete by what they
    explain of the rest; the null of all of them together comes from flipping the signs of whole poses.

    Args:
        folds, by: of the cross-validation, as in `calibrate`.
        flips: draws of the null; 299, and of thousands of rows, which need fewer, 99.
        test: other measurements, predicted with nothing refitted, or with base and tool if ``refit_frames``.
        with_time: keep effects of time in the arm to plan with; the task's ``time`` says when it is done.
        plan: whether report and document plan the task again with the arm that was found.
        seed: of the null, 0 by default, and of that plan.
        most_rows: data with more are thinned to so many, see `thin`; those left out judge the result, `LargeFile`.
        progress: receives (done, total) of its parts.

    Returns:
        ``Diagnosis``: ``verdict``, ``effects`` with their sizes, standard errors and p-values (SI units,
        radians), and ``extended``, the problem of the arm that was found.

    Raises:
        InputError: as `calibrate`.
        InsufficientDataError: fewer measurements than unknowns.

    Example:
        >>> import posture_opt as po
        >>> problem = po.load_problem("insert_planar_2r_measured")
        >>> data = po.read_measurements("problems/planar_2r_measured.csv", problem)
        >>> diagnosis = po.diagnose(problem, data, plan=False)
        >>> [finding.kind for finding in diagnosis.effects]
        ['geometry']
        >>> diagnosis.verdict, diagnosis.unexplained_places  # errors grow with both joints, and no posture was repeated
        ('unexplained', ('joint1', 'joint2'))
    """
    stages = Stages(progress, 20, 55, 5, 20)
    doubts, data = doubts_about(data), without_copies(data)
    thinning = thin(data, MOST_SEARCHED.rows(most_rows, problem.robot.n))
    data = data if thinning is None else thinning.used
    calibration = calibrate(problem, data, folds=folds, by=by, most_rows=len(data), progress=stages.next())
    draws = flips or (levels.SIGN_FLIPS if len(data) < levels.MANY_ROWS else levels.SIGN_FLIPS_OF_MANY_ROWS)
    found = explain_calibration(calibration, draws, seed or 0, stages)
    if met_exactly(found.model):
        return diagnose(
            problem, with_scatter(data), folds=folds, by=by, flips=flips, seed=seed, test=test,
            refit_frames=refit_frames, with_time=with_time, plan=plan, most_rows=most_rows, progress=progress,
        )  # fmt: skip
    consistent = found.calibration.request.problem  # without what the data refute of it
    request = FitRequest(consistent, data, folds, test, refit_frames, plan, seed)
    calibration, model, (groups, parts) = found.calibration, found.model, groups_and_folds(found.calibration)
    held = _held_out_errors(found, parts)
    delivery = _deliver(found, held, parts, with_time)
    held["delivered"] = delivery.held
    findings = _all_findings(found, groups, parts)
    stages.next()
    other, large = None, None
    if test is not None:  # predicted by the arm without effects of time
        persistent = _deliver(found, held, parts, with_time=False) if with_time else delivery
        other = second_session(test, calibration, model, persistent, refit_frames=refit_frames)
    if thinning is not None:
        large = LargeFile.of(thinning, three_models(calibration, model), model)
    stages.end()
    open_ = found.unnamed or found.uneven or found.adequacy.p_value < levels.LACK_OF_FIT_LEVEL
    return Diagnosis(
        verdict="unexplained" if open_ else "effects_found" if findings else "none_found",
        effects=findings,
        request=request,
        calibration=calibration,
        errors={name: Statistics.of(h.errors, groups) for name, h in held.items()},
        held=held,
        model=model,
        delivery=delivery,
        search=found.search,
        unexplained=found.unnamed,
        adequacy=found.adequacy,
        uneven=tuple(found.uneven),
        by=calibration.by,
        groups=groups,
        rivals=found.names.confusable,
        test=other,
        large=large,
        weights=found.weights,
        doubts=doubts,
        notes=(*calibration.notes, *(() if other is None else other.notes)),
    )


def _held_out_errors(found: Explained, parts: list[Codes]) -> dict[str, HeldOut]:
    """Errors on held-out rows before calibration, after it, and with the effects.

    The effects are chosen anew in each fold, so that their choice cannot profit from the rows that it is judged by.
    """
    calibration, model = found.calibration, found.model
    held = {name: errors.take(calibration.kept_rows) for name, errors in calibration.held.items()}
    shape = noise_shape(model, found.noise)
    if model.effects:
        held["extended"] = found.nested.held_out(found.geometry, found.names.size, shape)
    else:
        held["extended"] = replace(held_out(model, parts, shape=shape), errors=held["calibrated"].errors)
    return held


def _all_findings(found: Explained, groups: Codes, parts: list[Codes]) -> tuple[Finding, ...]:
    """The causes: what the data refute, effects and noise, then geometry; those of undetermined size behind others.

    Geometry is tested against the data alone: a prior would make a stated wrong value insignificant. What a former
    calibration has estimated is as certain as its covariance says; of stated sources, estimates alone are correlated.
    """
    calibration, residuals, full = found.calibration, found.linearised.sensitivities.residuals, found.model
    problem, parameters, estimated = calibration.request.problem, calibration.parameters, Estimated()
    if full.prior is not None:
        free = full.residuals.with_parameters(parameters)
        full = fit_with_effects(free, calibration.x, calibration.identifiability.directions, full.effects)
    if problem.sources.correlated:
        places, covariance = prior_covariance(problem, parameters)
        others = [i for i in places if parameters[i].group != "geometry"]
        estimated = Estimated(tuple(places), covariance).without(others)
    geometry = geometry_causes(
        residuals,
        calibration.x_nominal,
        free_directions(calibration.residuals, calibration.x_nominal),
        full,
        full.effects,
        parts,
        estimated,
    )
    beforehand = contradiction_findings(calibration)
    refuted = [c.cause for c in calibration.contradictions]
    effects = effect_findings(found.names, found.predictive, found.model, groups, found.unrefuted)
    effects = with_plausibility(effects, found.model, found.linearised.sensitivities.state.robot)
    return (
        *(f for f in beforehand if isinstance(f.cause, Effect)),
        *sorted((*effects, *map(noise_finding, found.noise)), key=lambda finding: not finding.determined),
        *(f for f in beforehand if not isinstance(f.cause, Effect)),
        *(g for g in geometry if g.cause not in refuted),
    )


def _deliver(found: Explained, held: Mapping[str, HeldOut], parts: list[Codes], with_time: bool) -> Delivery:
    """The arm to plan with; its errors are of effects chosen anew in each fold, too, without those not delivered."""
    nested, size = found.nested, found.names.size

    def judge(fit: Fit, gone: Sequence[Effect]) -> HeldOut:
        rest = nested.without(lambda e: not outlasts_session(e, with_time) or nearer_to(e, gone, fit.effects))
        return rest.held_out(found.geometry, size, noise_shape(fit, found.noise))

    model, deviations = found.predictive.fit, found.deviations
    return deliver_arm(found.calibration, model, deviations, held, parts, judge, with_time=with_time)


# Where nothing but rounding is left, rounding is explained: a joint that is off by 1 mrad would have company.
# Standard deviation of what is added to each number [m, rad]: a thousandth of what laser trackers resolve.
SCATTER = 1e-9


def met_exactly(model: Fit) -> bool:
    """Whether a model leaves less of measured positions than `SCATTER`."""
    residuals = model.residuals
    return residuals.data.position is not None and rms(model.whitened) * float(np.max(residuals.sigma)) < SCATTER


def with_scatter(data: Measurements) -> Measurements:
    """The rows with `SCATTER` added to positions and orientations, the same in every call; the data say so."""
    assert data.position is not None
    rng = np.random.default_rng(1)
    position = data.position + rng.normal(0.0, SCATTER, data.position.shape)
    rotation = data.rotation
    if rotation is not None:
        # Unit quaternions turned by small rotation vectors [rad].
        w, v, small = rotation[:, :1], rotation[:, 1:], rng.normal(0.0, SCATTER, (len(data), 3)) / 2
        turned = np.hstack([w - np.sum(small * v, axis=1, keepdims=True), v + w * small + np.cross(small, v)])
        rotation = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    note = "The rows are met to the last digit, as simulated ones are: each number got a scatter of 1 nm, or 1 nrad."
    return replace(data, position=position, rotation=rotation, notes=(*data.notes, note))
