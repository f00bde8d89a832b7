"""``diagnose``: from measurements to the causes of an arm's errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.assumptions.contradictions import GeometricDeviation
from posture_opt.calibration.calibrate import calibrate, of_problem, restated, reweighed
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.cross_validation import HeldOut, held_out
from posture_opt.calibration.doubts import (
    doubts_about,
    free_directions,
    turned_sides,
    with_sides_reversed,
    without_copies,
)
from posture_opt.calibration.estimation.error_statistics import By, Statistics, folds_of, groups_of
from posture_opt.calibration.estimation.fit import Fit, fit_with_effects
from posture_opt.calibration.estimation.fit_request import FitRequest, Stages
from posture_opt.calibration.estimation.parameters import known_rows, prior_covariance
from posture_opt.calibration.second_file import LargeFile
from posture_opt.calibration.weights import Reading, better_gravity, refuted_masses
from posture_opt.diagnosis.causes.causes import (
    Finding,
    contradiction_findings,
    effect_findings,
    noise_finding,
    with_plausibility,
)
from posture_opt.diagnosis.causes.delivered_arm import (
    Delivery,
    PredictiveModel,
    deliver_arm,
    nearer_to,
    outlasts_session,
)
from posture_opt.diagnosis.causes.determined_sizes import choice_deviations, with_choice_errors, with_mass_errors
from posture_opt.diagnosis.causes.geometry_causes import Estimated, determined_corrections, geometry_causes
from posture_opt.diagnosis.causes.sessions import second_session, three_models
from posture_opt.diagnosis.diagnosis import Diagnosis
from posture_opt.diagnosis.noise.noise_causes import joint_scatter, noise_causes, noise_shape, sided_joints
from posture_opt.diagnosis.noise.uneven_noise import NoiseCause, UnevenErrors
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.candidates import LinearisedData, linearise_calibration
from posture_opt.diagnosis.scores.lack_of_fit import Adequacy, HeldResiduals, assess_adequacy, lack_of_fit, left_of
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent, tool_points
from posture_opt.diagnosis.search.nested_selection import Folding, NestedSelection
from posture_opt.diagnosis.search.outlier_reinclusion import (
    explains_outliers,
    reinclude_outliers,
    without_clear_outliers,
    without_hidden_outliers,
)
from posture_opt.diagnosis.search.rivals import unrefuted_rivals
from posture_opt.diagnosis.search.search import SearchResult, keep_named, remaining_unnamed, search_effects
from posture_opt.interrupts import interruptible
from posture_opt.limits import MOST_SEARCHED
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.repeats import repeats_of_one_kind, thin
from posture_opt.model.effects import Effect
from posture_opt.model.effects.base.joint_effect import GravityLoaded
from posture_opt.numerics import Array, Codes, Progress, rms
from posture_opt.selection.problem_data import ProblemData
from posture_opt.validation.prediction import prismatic_joints


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
        problem, data: the arm and its measurements, as of `calibrate`.
        folds, by: of the cross-validation, as in `calibrate`.
        flips: draws of the null; 299, and of thousands of rows, which need fewer, 99.
        test, refit_frames: other measurements, predicted with nothing refitted, or with base and tool.
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
    exact, turned = met_exactly(found.model), turned_sides(data, found.model)
    if exact or turned:
        again = with_sides_reversed(data, turned)
        return diagnose(
            problem, with_scatter(again) if exact else again, folds=folds, by=by, flips=flips, seed=seed,
            test=None if test is None else with_sides_reversed(test, turned),
            refit_frames=refit_frames, with_time=with_time, plan=plan, most_rows=most_rows, progress=progress,
        )  # fmt: skip
    consistent = found.calibration.request.problem  # without what the data refute of it
    request = FitRequest(consistent, data, folds, test, refit_frames, plan, seed)
    calibration, model, (groups, parts) = found.calibration, found.model, groups_and_folds(found.calibration)
    held = _held_out_errors(found, parts)
    delivery = _deliver(found, held, parts, with_time)
    held["delivered"] = delivery.held
    findings = _all_findings(found, groups, parts)
    # What the data do not tell of all other parts may be in the size of a single one.
    if delivery.nominal or not determined_corrections(calibration, model):
        findings = tuple(replace(f, determined=not isinstance(f.cause, GeometricDeviation)) for f in findings)
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
    start = calibration.x_nominal
    free_frames = free_directions(calibration.residuals, start)
    geometry = geometry_causes(residuals, start, free_frames, full, full.effects, parts, estimated)
    beforehand = contradiction_findings(calibration)
    refuted = [c.cause for c in calibration.contradictions]
    effects = effect_findings(found.names, found.predictive, found.model, groups, found.unrefuted)
    effects = with_plausibility(effects, found.model, found.linearised.sensitivities.state.robot)
    # Where errors grow with a joint whose repeats agree, the loads may be others than stated: a compliance takes it up.
    open_ = {errors.effect.target for errors in found.uneven if errors.refuted or errors.still}
    effects = [
        replace(f, determined=f.determined and not (f.target in open_ and f.effect and "masses" in f.effect.asks))
        for f in effects
    ]
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


@dataclass(frozen=True)
class Explained:
    """What the residuals of a calibration hold, and the arm that was fitted with it.

    Args:
        deviations: (S, K, k) of its parameters beside the effects that each fold chose.
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
    weights: tuple[Reading, ...] = ()

    @cached_property
    def model(self) -> Fit:
        return with_mass_errors(with_choice_errors(self.predictive.fit, self.deviations))

    @property
    def names(self) -> SearchResult:
        """The search among candidates with names, where unnamed ones had to be taken."""
        return self.search.names or self.search

    @cached_property
    def nested(self) -> NestedSelection:
        return self.names.nested.each[0].with_moments_of(self.model.effects)


def explain_calibration(calibration: Calibration, draws: int, seed: int, stages: Stages) -> Explained:
    """What the residuals of a calibration hold, under the gravity and the masses that explain them best.

    Where the sag of the joints asks for another direction of gravity, or for other masses, all is searched for once
    more with these: they are taken if what is found then, a load among it, leaves clearly less, or needs fewer effects.
    """
    found = _explain(calibration, draws, seed, stages)
    judges: Sequence[Callable[[Calibration], Reading | None]] = (better_gravity, refuted_masses)
    for judge in judges:
        reading = judge(found.calibration)
        if reading is None:
            continue
        problem = reading.restated(found.calibration.request.problem)
        other = _explain(of_problem(found.calibration, problem), draws, seed)
        before, after = (one.model.variance for one in (found, other))
        evidence = len(other.model.whitened) / 2 * np.log(max(before, 1e-300) / max(after, 1e-300))
        evidence += levels.CHOICE_PENALTY * (len(found.model.effects) - len(other.model.effects))
        loaded = any(isinstance(effect, GravityLoaded) for effect in other.model.effects)
        if loaded and evidence > levels.RIVAL_CRITERION / 2:
            found = replace(other, weights=(*found.weights, reading))
    return found


def _explain(calibration: Calibration, draws: int, seed: int, stages: Stages | None = None) -> Explained:
    """What the residuals hold under gravity and masses as stated.

    Searched for once more where statements of the file prove wrong beside the effects, where orientations scatter
    otherwise than they were weighed for, or geometry was held near nominal which the data determine beside the effects:
    what hides in the calibrated arm's errors may have made it seem so. So it is where effects hid outliers.
    """
    calibration = without_clear_outliers(calibration)
    found = _explain_residuals(calibration, draws, seed, stages)
    for judge in (restated, reweighed):
        again = judge(calibration, found.model)
        if again is not None:
            calibration = again
            found = _explain_residuals(again, draws, seed)
    fewer = without_hidden_outliers(found.calibration, found.model)
    if fewer is not None:
        found = _explain_residuals(fewer, draws, seed)
    return found


def _explain_residuals(calibration: Calibration, draws: int, seed: int, stages: Stages | None = None) -> Explained:
    calibration, linearised, found = _search_effects(calibration, draws, seed, stages or Stages(None, 1, 1))
    found, predictive = _needed_effects(calibration, linearised, found)
    model, residuals = predictive.fit, linearised.sensitivities.residuals
    geometry, names = calibration.fit_effects(residuals, []), found.names or found
    deviations = np.zeros((1, 0, len(model.x)))
    if model.effects:
        deviations = choice_deviations(model, geometry, names.nested.each[0], names.size)
    unnamed = tuple(s.what for s in remaining_unnamed(linearised, found) if isinstance(s.what, UnnamedComponent))
    everything = linearised.baseline(found.chosen)
    repeated = repeats_of_one_kind(residuals.data, prismatic_joints(residuals), sided_joints(model))
    held = _held_by_prior(calibration, linearised, found)
    left = assess_adequacy(
        everything, residuals.data, repeated, tool_points(linearised.sensitivities), residuals.block, held
    )
    p_value = 0.0 if unnamed else left.p_value
    noise, uneven = noise_causes(calibration.request.problem, calibration, model, everything, p_value, seed)
    scatter = joint_scatter(model, noise)
    if scatter is not None:
        held = held or left_of(everything, residuals.measured)
        left = replace(left, lack_of_fit=lack_of_fit(held, residuals.data, repeated, residuals.block, scatter))
    open_ = unnamed or uneven or left.p_value < levels.LACK_OF_FIT_LEVEL
    unrefuted: Mapping[int, tuple[Effect, ...]] = {}
    if open_:
        blocks = names.nested.each[-1].groups
        unrefuted = unrefuted_rivals(linearised, names.chosen, names.rivals, names.scored, blocks)
    return Explained(
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
    folds = groups_and_folds(calibration)[1]
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


def _search_effects(
    calibration: Calibration, draws: int, seed: int, stages: Stages
) -> tuple[Calibration, LinearisedData, SearchResult]:  # fmt: skip
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


def groups_and_folds(calibration: Calibration) -> tuple[Codes, list[Codes]]:
    """Groups (M,) and folds of the calibration, of the rows that count."""
    request, by, kept = calibration.request, calibration.by, calibration.kept_rows
    groups = groups_of(request.data, by, request.folds)
    place = np.full(len(groups), -1)
    place[kept] = np.arange(len(kept))
    parts = (place[part][place[part] >= 0] for part in folds_of(groups, request.folds, by))
    return groups[kept], [part for part in parts if len(part)]


def _selection_folds(calibration: Calibration) -> tuple[Folding, ...]:
    data = calibration.request.data.take(calibration.kept_rows)
    own = Folding(*groups_and_folds(calibration))
    if data.position is None or calibration.by == "block":
        return (own,)
    return own, Folding.of(data, "block", calibration.request.folds)
