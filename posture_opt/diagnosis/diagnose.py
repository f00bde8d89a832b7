"""``diagnose``: from measurements to the causes of an arm's errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from posture_opt.calibration.calibrate import calibrate
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.cross_validation import HeldOut, held_out
from posture_opt.calibration.doubts import doubts_about, without_copies
from posture_opt.calibration.estimation.effects_fit import fit_with_effects
from posture_opt.calibration.estimation.error_statistics import By, Statistics
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.fit_request import FitRequest
from posture_opt.calibration.estimation.parameters import prior_covariance
from posture_opt.calibration.estimation.progress import Stages
from posture_opt.calibration.large_file import LargeFile
from posture_opt.calibration.other_preset import free_directions
from posture_opt.diagnosis.causes.causes import (
    Finding,
    contradiction_findings,
    effect_findings,
    geometry_finding,
    noise_finding,
)
from posture_opt.diagnosis.causes.delivered_effects import Delivery, deliver_arm, nearer_to, outlasts_session
from posture_opt.diagnosis.causes.geometry_causes import Estimated, geometry_causes
from posture_opt.diagnosis.causes.plausible_causes import FittedEffects, with_plausibility
from posture_opt.diagnosis.causes.sessions import SecondSession, second_session
from posture_opt.diagnosis.diagnosis import Diagnosis, Outcome
from posture_opt.diagnosis.exact_rows import met_exactly, with_scatter
from posture_opt.diagnosis.explained import Explained, explain_calibration, groups_and_folds
from posture_opt.diagnosis.noise.noise_causes import noise_shape
from posture_opt.diagnosis.scores import levels
from posture_opt.interrupts import interruptible
from posture_opt.limits import MOST_SEARCHED
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.thinning import Thinning, thin
from posture_opt.model.effects import Effect
from posture_opt.numerics import Codes, Progress
from posture_opt.selection.problem_data import ProblemData


@dataclass(frozen=True)
class _HeldOut:
    """Errors of rows that a model has not seen, by model, and how the rows were left out.

    Args:
        models: ``extended`` chooses its effects anew in each round.
        groups: (N,) what was left out together; ``parts`` the rounds.
    """

    models: Mapping[str, HeldOut]
    groups: Codes
    parts: list[Codes]


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
    held = _held_out_errors(found)
    delivery = _deliver(found, held, with_time)
    held = replace(held, models={**held.models, "delivered": delivery.held})
    findings = _all_findings(found, held)
    stages.next()
    other = None if test is None else _predict_session(test, found, held, delivery, with_time, refit_frames)
    large = None if thinning is None else _left_out_rows(thinning, found)
    stages.end()
    return replace(_assemble_diagnosis(request, found, held, delivery, findings, other), large=large, doubts=doubts)


def _held_out_errors(found: Explained) -> _HeldOut:
    """Errors on held-out rows before calibration, after it, and with the effects.

    The effects are chosen anew in each fold, so that their choice cannot profit from the rows that it is judged by.
    """
    calibration, model = found.calibration, found.model
    groups, parts = groups_and_folds(calibration)
    held = {name: errors.take(calibration.kept_rows) for name, errors in calibration.held.items()}
    shape = noise_shape(model, found.noise)
    if model.effects:
        held["extended"] = found.nested.held_out(found.geometry, found.names.size, shape)
    else:
        held["extended"] = replace(held_out(model, parts, shape=shape), errors=held["calibrated"].errors)
    return _HeldOut(held, groups, parts)


def _all_findings(found: Explained, held: _HeldOut) -> tuple[Finding, ...]:
    """The causes: what the data refute, effects and noise, then geometry.

    Geometry is tested against the data alone: a prior would make a stated wrong value insignificant. What a former
    calibration has estimated is as certain as its covariance says.
    """
    calibration, residuals = found.calibration, found.linearised.sensitivities.residuals
    full = _of_data(found.model, calibration)
    geometry = geometry_causes(
        residuals,
        calibration.x_nominal,
        free_directions(calibration.residuals, calibration.x_nominal),
        full,
        full.effects,
        held.parts,
        _estimated_before(calibration),
    )
    beforehand = contradiction_findings(calibration)
    refuted = [c.cause for c in calibration.contradictions]
    effects = effect_findings(found.names, found.predictive, found.model, held.groups, found.unrefuted)
    effects = with_plausibility(effects, FittedEffects(found.model, found.linearised.sensitivities.state.robot))
    return (
        *(f for f in beforehand if isinstance(f.cause, Effect)),
        *_determined_first(*effects, *map(noise_finding, found.noise)),
        *(f for f in beforehand if not isinstance(f.cause, Effect)),
        *(geometry_finding(g) for g in geometry if g.deviation not in refuted),
    )


def _deliver(found: Explained, held: _HeldOut, with_time: bool) -> Delivery:
    """The arm to plan with, with effects of time or without.

    Its errors are of effects chosen anew in each fold, too, without those that are not delivered.
    """
    nested, size = found.nested, found.names.size

    def judge(fit: Fit, gone: Sequence[Effect]) -> HeldOut:
        rest = nested.without(lambda e: not outlasts_session(e, with_time) or nearer_to(e, gone, fit.effects))
        return rest.held_out(found.geometry, size, noise_shape(fit, found.noise))

    model, deviations = found.predictive.fit, found.deviations
    return deliver_arm(found.calibration, model, deviations, held.models, held.parts, judge, with_time=with_time)


def _predict_session(
    test: Measurements, found: Explained, held: _HeldOut, delivery: Delivery, with_time: bool, refit_frames: bool
) -> SecondSession:
    """The other file predicted, by the arm without effects of time.

    Args:
        with_time: whether effects of time are in the delivered arm; the other file is predicted without them.
    """
    calibration, model = found.calibration, found.model
    persistent = _deliver(found, held, with_time=False) if with_time else delivery
    return second_session(test, calibration, model, persistent, refit_frames=refit_frames)


def _left_out_rows(thinning: Thinning, found: Explained) -> LargeFile:
    """The rows left out, predicted by the arm before calibration, the calibrated one, and that with its effects.

    Returns:
        Their errors by model, none of which saw them.
    """
    calibrated, model = found.calibration.fit, found.model
    models = {
        "nominal": (calibrated.residuals, found.calibration.x_nominal),
        "calibrated": (calibrated.residuals, calibrated.x),
        "extended": (model.residuals, model.x),
    }
    return LargeFile.of(thinning, models, model)


def _assemble_diagnosis(
    request: FitRequest,
    found: Explained,
    held: _HeldOut,
    delivery: Delivery,
    findings: tuple[Finding, ...],
    other: SecondSession | None,
) -> Diagnosis:
    """The result: ``unexplained`` where a test of what is left is significant, or errors are uneven."""
    open_ = found.adequacy_p_value < levels.LACK_OF_FIT_LEVEL or bool(found.uneven)
    verdict: Outcome = "unexplained" if open_ else "effects_found" if findings else "none_found"
    calibration = found.calibration
    return Diagnosis(
        verdict=verdict,
        effects=findings,
        request=request,
        calibration=calibration,
        errors={name: Statistics.of(h.errors, held.groups) for name, h in held.models.items()},
        held=held.models,
        model=found.model,
        delivery=delivery,
        search=found.search,
        unexplained=found.unnamed,
        adequacy=found.adequacy,
        uneven=tuple(found.uneven),
        weights=found.weights,
        by=calibration.by,
        groups=held.groups,
        rivals=found.names.confusable,
        test=other,
        notes=(*calibration.notes, *(() if other is None else other.notes)),
    )


def _determined_first(*findings: Finding) -> list[Finding]:
    """The findings in their order, those whose size the data do not determine last."""
    return sorted(findings, key=lambda finding: not finding.determined)


def _estimated_before(calibration: Calibration) -> Estimated:
    """What the file has from a former calibration: of stated sources, estimates alone are correlated."""
    problem, parameters = calibration.request.problem, calibration.parameters
    if not problem.sources.correlated:
        return Estimated()
    places, covariance = prior_covariance(problem, parameters)
    return Estimated(tuple(places), covariance).without([i for i in places if parameters[i].group != "geometry"])


def _of_data(model: Fit, calibration: Calibration) -> Fit:
    """The model without its prior: by the data alone geometry is judged a cause, whatever is stated of it."""
    if model.prior is None:
        return model
    directions = calibration.identifiability.directions
    residuals = model.residuals.with_parameters(calibration.parameters)
    return fit_with_effects(residuals, calibration.x, directions, model.effects)
