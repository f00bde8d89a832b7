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
from posture_opt.calibration.estimation.fit_request import Stages
from posture_opt.calibration.estimation.parameters import known_rows
from posture_opt.calibration.weights import (
    Reading,
    better_gravity,
    refuted_masses,
)
from posture_opt.diagnosis.causes.delivered_arm import PredictiveModel
from posture_opt.diagnosis.causes.determined_sizes import choice_deviations, with_choice_errors, with_mass_errors
from posture_opt.diagnosis.noise.noise_causes import joint_scatter, noise_causes, sided_joints
from posture_opt.diagnosis.noise.uneven_noise import NoiseCause, UnevenErrors
from posture_opt.diagnosis.scores import levels
from posture_opt.diagnosis.scores.lack_of_fit import Adequacy, HeldResiduals, assess_adequacy, lack_of_fit, left_of
from posture_opt.diagnosis.scores.unnamed_components import UnnamedComponent, tool_points
from posture_opt.diagnosis.search.linearised_data import (
    LinearisedData,
    linearise_calibration,
)
from posture_opt.diagnosis.search.nested_selection import Folding, NestedSelection
from posture_opt.diagnosis.search.outlier_reinclusion import (
    explains_outliers,
    reinclude_outliers,
    without_clear_outliers,
    without_hidden_outliers,
)
from posture_opt.diagnosis.search.rivals import unrefuted_rivals
from posture_opt.diagnosis.search.search import SearchResult, keep_named, remaining_unnamed, search_effects
from posture_opt.measurements.repeats import repeats_of_one_kind
from posture_opt.model.effects import Effect
from posture_opt.model.effects.base.gravity_load import GravityLoaded
from posture_opt.numerics import Array, Codes
from posture_opt.validation.prediction import prismatic_joints


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
    """The arm with what a search found, and what it leaves."""
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
