"""``diagnose``: from measurements to the causes of an arm's errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.calibrate import calibrate, restated, reweighed
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.cross_validation import HeldOut, held_out
from posture_opt.calibration.estimation.error_statistics import By, Statistics, folds_of, groups_of
from posture_opt.calibration.estimation.fit import Fit, fit_with_effects, known_rows
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
from posture_opt.diagnosis.causes.predictive_effects import PredictiveModel
from posture_opt.diagnosis.causes.selected_sizes import choice_deviations, with_choice_errors
from posture_opt.diagnosis.causes.sessions import SecondSession, second_session
from posture_opt.diagnosis.diagnosis import Diagnosis, Outcome
from posture_opt.diagnosis.exact_rows import met_exactly, with_scatter
from posture_opt.diagnosis.noise.noise_causes import joint_scatter, noise_causes, noise_shape
from posture_opt.diagnosis.noise.uneven_noise import NoiseCause, UnevenErrors
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.lack_of_fit import Adequacy, HeldResiduals, assess_adequacy, lack_of_fit, left_of
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent
from posture_opt.diagnosis.search.linearised_data import (
    LinearisedData,
    linearise_calibration,
    tool_points,
)
from posture_opt.diagnosis.search.nested_selection import Folding, NestedSelection
from posture_opt.diagnosis.search.outlier_reinclusion import (
    explains_outliers,
    reinclude_outliers,
    without_hidden_outliers,
)
from posture_opt.diagnosis.search.search import SearchResult, keep_named, remaining_unnamed, search_effects
from posture_opt.diagnosis.search.unrefuted_rivals import unrefuted_rivals
from posture_opt.interrupts import interruptible
from posture_opt.limits import MOST_SEARCHED
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import repeat_groups
from posture_opt.measurements.thinning import Thinning, thin
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Codes, Progress
from posture_opt.selection.problem_data import ProblemData
from posture_opt.validation.repeat_scatter import prismatic_joints


@dataclass(frozen=True)
class _Explained:
    """What the residuals of a calibration hold, and the arm that was fitted with it.

    Args:
        geometry: the calibrated arm; ``predictive`` with the effects that have a name and that held-out rows need.
        deviations: (S, K, k) of its parameters beside the effects that each fold chose.
        unnamed: the further components.
        adequacy: the tests for anything left.
        noise, uneven: causes that move nothing, and errors that look like one.
        unrefuted: by place among the names, effects that explain no clearly less, where more than noise is left.
    """

    calibration: Calibration
    linearised: LinearisedData
    search: SearchResult
    geometry: Fit
    predictive: PredictiveModel
    deviations: Array
    unnamed: tuple[UnnamedComponent, ...]
    adequacy: Adequacy
    noise: Sequence[NoiseCause]
    uneven: Sequence[UnevenErrors]
    unrefuted: Mapping[int, tuple[Effect, ...]]

    @cached_property
    def model(self) -> Fit:
        """The calibrated arm with the effects that have a name."""
        return with_choice_errors(self.predictive.fit, self.deviations)

    @property
    def names(self) -> SearchResult:
        """The search among candidates with names, where unnamed ones had to be taken."""
        return self.search.names or self.search

    @cached_property
    def nested(self) -> NestedSelection:
        """What each fold chose among them."""
        return self.names.nested.each[0].with_moments_of(self.model.effects)

    @property
    def adequacy_p_value(self) -> float:
        """p-value of the tests for anything left; zero where there are unnamed components."""
        return 0.0 if self.unnamed else self.adequacy.p_value


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
    thinning = thin(data, MOST_SEARCHED.rows(most_rows, problem.robot.n))
    data = data if thinning is None else thinning.used
    calibration = calibrate(problem, data, folds=folds, by=by, most_rows=len(data), progress=stages.next())
    draws = flips or (levels.SIGN_FLIPS if len(data) < levels.MANY_ROWS else levels.SIGN_FLIPS_OF_MANY_ROWS)
    found = _explain_calibration(calibration, draws, seed or 0, stages)
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
    return replace(_assemble_diagnosis(request, found, held, delivery, findings, other), large=large)


def _explain_calibration(calibration: Calibration, draws: int, seed: int, stages: Stages) -> _Explained:
    """What the residuals of a calibration hold.

    It is searched for once more where that shows that statements of the file are wrong beside the effects, that
    orientations scatter otherwise, beside positions, than they were weighed for, or that geometry was held near nominal
    which the data determine beside the effects: what hides in the calibrated arm's errors may have made it seem so, or
    a σ that is stated wrongly. So it is where effects hid outliers.
    """
    found = _explain_residuals(*_search_effects(calibration, draws, seed, stages), seed)
    for judge in (restated, reweighed):
        again = judge(calibration, found.model)
        if again is not None:
            calibration = again
            found = _explain_residuals(*_search_effects(again, draws, seed, Stages(None, 1, 1)), seed)
    fewer = without_hidden_outliers(found.calibration, found.model)
    if fewer is not None:
        found = _explain_residuals(*_search_effects(fewer, draws, seed, Stages(None, 1, 1)), seed)
    return found


def _explain_residuals(
    calibration: Calibration, linearised: LinearisedData, found: SearchResult, seed: int
) -> _Explained:
    """The arm with what was found, and what it leaves.

    Args:
        found: the search among all candidates; effects of its named set are fitted together with the geometry.
        calibration, linearised: of the rows that count; seed: of the null distribution of noise.
    """
    found, predictive = _needed_effects(calibration, linearised, found)
    model, residuals = predictive.fit, linearised.sensitivities.residuals
    geometry, names = calibration.fit_effects(residuals, []), found.names or found
    deviations = np.zeros((1, 0, len(model.x)))
    if model.effects:
        deviations = choice_deviations(model, geometry, names.nested.each[0], names.size)
    unnamed = tuple(s.what for s in remaining_unnamed(linearised, found) if isinstance(s.what, UnnamedComponent))
    everything = linearised.baseline(found.chosen)
    repeated = repeat_groups(residuals.data, prismatic_joints(residuals))
    held = _held_by_prior(calibration, linearised, found)
    left = assess_adequacy(everything, residuals.data, repeated, tool_points(linearised), residuals.block, held)
    p_value = 0.0 if unnamed else left.p_value
    noise, uneven = noise_causes(calibration.request.problem, calibration, model, everything, p_value, seed)
    scatter = joint_scatter(model, noise)
    if scatter is not None:
        held = held or left_of(everything, residuals.measured)
        again = lack_of_fit(held, residuals.data, repeated, residuals.block, scatter)
        left = replace(left, lack_of_fit=again)
    open_ = unnamed or uneven or left.p_value < levels.LACK_OF_FIT_LEVEL
    unrefuted = unrefuted_rivals(linearised, names) if open_ else {}
    return _Explained(
        calibration, linearised, found, geometry, predictive, deviations, unnamed, left, noise, uneven, unrefuted
    )


def _needed_effects(
    calibration: Calibration, linearised: LinearisedData, found: SearchResult
) -> tuple[SearchResult, PredictiveModel]:
    """The search without the named effects that held-out rows do not need, and the arm with the others.

    They need none of a set that predicts them no better than geometry alone, chosen anew without them.
    """
    names = found.names or found
    offered = [s.what for s in names.chosen if isinstance(s.what, Effect)]
    folds = _groups_and_folds(calibration)[1]
    worthless = bool(offered) and names.nested.each[0].gains_nothing(names.size)
    predictive = PredictiveModel.of(calibration, [] if worthless else offered, folds)
    fewer = keep_named(linearised, names, predictive.kept)
    return (fewer if found.names is None else replace(found, names=fewer)), predictive


def _held_by_prior(calibration: Calibration, linearised: LinearisedData, found: SearchResult) -> HeldResiduals | None:
    """What is left where the prior holds the geometry beside all that was found; None where nothing is known of it.

    The search lets the geometry free: what a wrong prior leaves is nothing that an effect could explain.
    """
    fit, residuals = calibration.fit, linearised.sensitivities.residuals
    if fit.prior is None:
        return None
    r, J = residuals.residuals_and_jacobian(calibration.x)
    known = known_rows(fit.prior, fit.weight, np.eye(len(fit.x)))
    effects = [s.Z[: residuals.measured] for s in found.chosen]
    columns = np.concatenate([J[: residuals.measured] @ fit.directions, *effects], axis=1)
    free = np.zeros((len(known), columns.shape[1] - fit.directions.shape[1]))
    rows = np.concatenate([known @ fit.directions, free], axis=1)
    return HeldResiduals.of(r[: residuals.measured], columns, known @ fit.x, rows)


def _held_out_errors(found: _Explained) -> _HeldOut:
    """Errors on held-out rows before calibration, after it, and with the effects.

    The effects are chosen anew in each fold, so that their choice cannot profit from the rows that it is judged by.
    """
    calibration, model = found.calibration, found.model
    groups, parts = _groups_and_folds(calibration)
    held = {name: errors.take(calibration.kept_rows) for name, errors in calibration.held.items()}
    shape = noise_shape(model, found.noise)
    if model.effects:
        held["extended"] = found.nested.held_out(found.geometry, found.names.size, shape)
    else:
        held["extended"] = replace(held_out(model, parts, shape=shape), errors=held["calibrated"].errors)
    return _HeldOut(held, groups, parts)


def _all_findings(found: _Explained, held: _HeldOut) -> tuple[Finding, ...]:
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


def _deliver(found: _Explained, held: _HeldOut, with_time: bool) -> Delivery:
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
    test: Measurements, found: _Explained, held: _HeldOut, delivery: Delivery, with_time: bool, refit_frames: bool
) -> SecondSession:
    """The other file predicted, by the arm without effects of time.

    Args:
        with_time: whether effects of time are in the delivered arm; the other file is predicted without them.
    """
    calibration, model = found.calibration, found.model
    persistent = _deliver(found, held, with_time=False) if with_time else delivery
    return second_session(test, calibration, model, persistent, refit_frames=refit_frames)


def _left_out_rows(thinning: Thinning, found: _Explained) -> LargeFile:
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
    found: _Explained,
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
        by=calibration.by,
        groups=held.groups,
        rivals=found.names.confusable,
        test=other,
        notes=(*calibration.notes, *(() if other is None else other.notes)),
    )


def _determined_first(*findings: Finding) -> list[Finding]:
    """The findings in their order, those whose size the data do not determine last."""
    return sorted(findings, key=lambda finding: not finding.determined)


def _groups_and_folds(calibration: Calibration) -> tuple[Codes, list[Codes]]:
    """Groups (M,) and folds of the calibration, of the rows that count."""
    request, by, kept = calibration.request, calibration.by, calibration.kept_rows
    groups = groups_of(request.data, by, request.folds)
    place = np.full(len(groups), -1)
    place[kept] = np.arange(len(kept))
    parts = (place[part][place[part] >= 0] for part in folds_of(groups, request.folds, by))
    return groups[kept], [part for part in parts if len(part)]


def _selection_folds(calibration: Calibration) -> tuple[Folding, ...]:
    """How rows are left out: as the calibration does, by which errors are stated, and by block too where it can be."""
    data = calibration.request.data.take(calibration.kept_rows)
    own = Folding(*_groups_and_folds(calibration))
    if data.position is None or calibration.by == "block":
        return (own,)
    return own, Folding.of(data, "block", calibration.request.folds)


def _search_effects(
    calibration: Calibration, draws: int, seed: int, stages: Stages
) -> tuple[Calibration, LinearisedData, SearchResult]:  # fmt: skip
    """What the residuals hold; searched once more where effects explain rows that looked like outliers."""
    linearised = linearise_calibration(calibration, draws, seed)
    foldings = _selection_folds(calibration)
    found = search_effects(linearised, foldings, stages.rounds(stages.next()))
    stages.next()
    wider = reinclude_outliers(calibration, found)
    if len(wider.outliers) == len(calibration.outliers):
        return calibration, linearised, found
    all_linearised = linearise_calibration(wider, draws, seed)
    among_all = search_effects(all_linearised, _selection_folds(wider))
    if not explains_outliers(calibration, among_all):
        return calibration, linearised, found
    return wider, all_linearised, among_all


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
