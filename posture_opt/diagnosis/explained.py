"""``Explained``: what the residuals of a calibration hold, and the arm that was fitted with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.calibrate import of_problem, restated, reweighed
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.estimation.error_statistics import folds_of, groups_of
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.prior import known_rows
from posture_opt.calibration.estimation.progress import Stages
from posture_opt.calibration.weights import (
    Reading,
    better_gravity,
    refuted_masses,
)
from posture_opt.diagnosis.causes.mass_errors import with_mass_errors
from posture_opt.diagnosis.causes.predictive_effects import PredictiveModel
from posture_opt.diagnosis.causes.selected_sizes import choice_deviations, with_choice_errors
from posture_opt.diagnosis.noise.noise_causes import joint_scatter, noise_causes, sided_joints
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
    without_clear_outliers,
    without_hidden_outliers,
)
from posture_opt.diagnosis.search.search import SearchResult, keep_named, remaining_unnamed, search_effects
from posture_opt.diagnosis.search.unrefuted_rivals import unrefuted_rivals
from posture_opt.measurements.repeats import repeats_of_one_kind
from posture_opt.model.effects import Effect
from posture_opt.model.effects.base.gravity_load import GravityLoaded
from posture_opt.numerics import Array, Codes
from posture_opt.validation.repeat_scatter import prismatic_joints


@dataclass(frozen=True)
class Explained:
    """What the residuals of a calibration hold, and the arm that was fitted with it.

    Args:
        geometry: the calibrated arm; ``predictive`` with the effects that have a name and that held-out rows need.
        deviations: (S, K, k) of its parameters beside the effects that each fold chose.
        unnamed: the further components.
        adequacy: the tests for anything left.
        noise, uneven: causes that move nothing, and errors that look like one.
        weights: gravity, and masses, where they are not as the file was taken to say.
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
    weights: tuple[Reading, ...] = ()

    @cached_property
    def model(self) -> Fit:
        """The calibrated arm with the effects that have a name."""
        return with_mass_errors(with_choice_errors(self.predictive.fit, self.deviations))

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


def explain_calibration(calibration: Calibration, draws: int, seed: int, stages: Stages) -> Explained:
    """What the residuals of a calibration hold, under the gravity and the masses that explain them best.

    Where the sag of the joints asks for another direction of gravity, or for other masses, all is searched for once
    more with these: they are taken if what is found then, a load among it, leaves clearly less, or needs fewer effects.
    """
    found = _explain(calibration, draws, seed, stages)
    judges: tuple[Callable[[Calibration], Reading | None], ...] = (better_gravity, refuted_masses)
    for judge in judges:
        reading = judge(found.calibration)
        if reading is None:
            continue
        problem = reading.restated(found.calibration.request.problem)
        other = _explain(of_problem(found.calibration, problem), draws, seed, Stages(None, 1, 1))
        before, after = (one.model.variance for one in (found, other))
        evidence = len(other.model.whitened) / 2 * np.log(max(before, 1e-300) / max(after, 1e-300))
        evidence += levels.CHOICE_PENALTY * (len(found.model.effects) - len(other.model.effects))
        loaded = any(isinstance(effect, GravityLoaded) for effect in other.model.effects)
        if loaded and evidence > levels.RIVAL_CRITERION / 2:
            found = replace(other, weights=(*found.weights, reading))
    return found


def _explain(calibration: Calibration, draws: int, seed: int, stages: Stages) -> Explained:
    """What the residuals hold under gravity and masses as stated.

    It is searched for once more where that shows that statements of the file are wrong beside the effects, that
    orientations scatter otherwise, beside positions, than they were weighed for, or that geometry was held near nominal
    which the data determine beside the effects: what hides in the calibrated arm's errors may have made it seem so, or
    a σ that is stated wrongly. So it is where effects hid outliers.
    """
    calibration = without_clear_outliers(calibration)
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
) -> Explained:
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
    repeated = repeats_of_one_kind(residuals.data, prismatic_joints(residuals), sided_joints(model))
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


def groups_and_folds(calibration: Calibration) -> tuple[Codes, list[Codes]]:
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
    own = Folding(*groups_and_folds(calibration))
    if data.position is None or calibration.by == "block":
        return (own,)
    return own, Folding.of(data, "block", calibration.request.folds)
