"""Standard errors that know of the choice: how far an effect differs between folds that chose their effects anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from posture_opt.calibration.cross_validation import refit_of_fold, residual_indices
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.diagnosis.search.nested_selection import NestedSelection
from posture_opt.numerics import Array

Factors = Mapping[tuple[str, str], float]
"""Kind and target of an effect -> by how much its standard errors are larger than those of a model that is given."""

_MIN_FOLDS = 3  # fewer values have no standard deviation to speak of


def selection_factors(model: Fit, calibrated: Fit, nested: NestedSelection, size: int) -> Factors:
    """By how much the choice of effects, of their shapes and of their neighbours widens the errors of each effect.

    A standard error holds for the model that was chosen; other rows choose other lines of a joint, and what these leave
    out goes into the rest. The jackknife over K folds, each with the set that it chose by itself, knows of all that:
    ``V = (K − 1)/K Σ |e_k − ē|²`` with the motions e_k (m,) of the residuals by the effect. By the model as it was
    chosen that is ``tr(B C Bᵀ)``; the larger one counts.

    Args:
        calibrated: the fit of the geometry alone; nested: the sets of each fold, ``size`` effects of each.

    Returns:
        ``max(1, √(V / tr(B C Bᵀ)))`` by effect; 1 of one that fewer than three folds chose.

    Source: Shao, Tu, The Jackknife and Bootstrap (1995), section 2.3 (groups); of the choice, Breiman (1992).
    """
    folds = _motions(calibrated, nested, size)
    factors = {}
    for i, effect in enumerate(model.effects):
        own = np.array([moved[effect.kind, effect.target] for moved in folds if (effect.kind, effect.target) in moved])
        part, B = model.slices[i], model.effect_columns(i)
        given = float(np.trace(B.T @ B @ model.covariance[part, part]))
        if len(own) < _MIN_FOLDS or not given > 0:
            continue
        V = (len(folds) - 1) * float(np.mean(np.sum((own - own.mean(axis=0)) ** 2, axis=1)))
        factors[effect.kind, effect.target] = max(1.0, float(np.sqrt(V / given)))
    return factors


def with_selection_errors(fit: Fit, factors: Factors) -> Fit:
    """The same estimate, the covariance of parameters and shape of each effect larger by the square of its factor.

    What they have in common with other parameters stays: ``C + diag((f_i² − 1) C_ii)``.
    """
    C = fit.C.copy()
    for i, effect in enumerate(fit.effects):
        part = fit.slices[i]
        own = fit.directions[part.start : part.stop + (i in fit.shapes)]
        steps = np.flatnonzero(np.any(own, axis=0))
        C[np.ix_(steps, steps)] *= factors.get((effect.kind, effect.target), 1.0) ** 2
    return replace(fit, C=C)


def _motions(calibrated: Fit, nested: NestedSelection, size: int) -> list[dict[tuple[str, str], Array]]:
    """For each fold how far each effect of its own set moves the residuals (m,), by kind and target.

    Lines of one joint are one effect.
    """
    folds = []
    for left_out, linear, effects, columns in nested.fitted_sets(calibrated, size):
        theirs = residual_indices(left_out, calibrated.residuals.block)
        step, _ = refit_of_fold(linear, linear.r, np.arange(linear.K.shape[1]), theirs)
        moved: dict[tuple[str, str], Array] = {}
        first = len(step) - sum(B.shape[1] for B in columns)
        for effect, B in zip(effects, columns, strict=True):
            norms = np.linalg.norm(B, axis=0)
            one = B @ (step[first : first + B.shape[1]] / np.where(norms > 0, norms, 1.0))
            moved[effect.kind, effect.target] = moved.get((effect.kind, effect.target), 0.0) + one
            first += B.shape[1]
        folds.append(moved)
    return folds
