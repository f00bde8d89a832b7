"""Standard errors that know of the choice: how far the sizes of effects differ between folds that chose anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posture_opt.calibration.cross_validation import refit_of_fold, residual_indices
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.linear_model import LinearModel
from posture_opt.diagnosis.search.nested_selection import NestedSelection
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Codes

_MIN_FOLDS = 2  # one alone differs from nothing
_RANK_TOLERANCE = 1e-10  # of unit columns: a shape that does what sine and cosine do is not told from them


def choice_deviations(model: Fit, calibrated: Fit, nested: NestedSelection, size: int) -> Array:
    """By how much the parameters of a model are others beside the effects that each fold chose by itself.

    A standard error holds for the model that was chosen. Other rows choose other neighbours: another line of the joint,
    a rival of the one next to it; and what these leave out goes into the rest. To the rows of every fold two models are
    fitted: this one, and the geometry with what the fold chose and those effects of the model that it lacks. Where it
    has an effect of the same kind and target, of other shapes, that one is expressed by the columns of the model's.

    How many effects there are was chosen, too: where more of them predict rows left out better, but not clearly, those
    that are left out may be there all the same. Sets of that size are as good a choice, and compared alike.

    Args:
        model: everything that is stated; calibrated: the fit of the geometry alone.
        nested: the sets of each fold, ``size`` effects of each.

    Returns:
        (S, K, k) parameters beside what each of K folds chose of S sizes, one or two, minus those of this model [SI];
            zero where it chose alike.
    """
    sizes = np.setdiff1d(np.arange(model.directions.shape[1]), model.geometry)
    own = LinearModel.with_columns(model, model.residuals_and_jacobian[1] @ model.directions[:, sizes])
    steps = model.directions[:, np.concatenate([model.geometry, sizes])]
    counts = (size, nested.best) if nested.best > size else (size,)
    found = np.zeros((len(counts), len(nested.folds), len(model.x)))
    for i, count in enumerate(counts):
        for k, fold in enumerate(nested.fitted_sets(calibrated, count, model.effects)):
            here = model.x + steps @ _refitted(own, fold[0], model)
            found[i, k] = _fold_estimate(model, calibrated, *fold) - here
    return found


def with_choice_errors(fit: Fit, deviations: Array) -> Fit:
    """The same estimate, its neighbours unknown as its parameters are: ``C + (t / 1.96)² Σ δ_k δ_kᵀ / (K − 1)``.

    Of sets of several sizes it is the mean of all sizes.

    The first part is the error within the model, the second that between models. With t, the 97.5 % quantile of
    Student's distribution of the K − 1 degrees of freedom of so few folds, two standard errors mean what they always
    do. What one model gives to the geometry or to another effect, and another takes from it, stays correlated.

    Args:
        deviations: δ (S, K, k) of the parameters, from `choice_deviations`.

    Sources: Buckland, Burnham, Augustin (1997), equation 4, the choices of the folds for the models; JCGM 100:2008,
    annex G.3, for t.
    """
    from scipy.special import stdtrit

    sizes, folds, _ = deviations.shape
    if folds < _MIN_FOLDS or not np.any(deviations):
        return fit
    freedom = folds - 1
    steps = deviations.reshape(sizes * folds, -1) @ np.linalg.pinv(fit.directions).T
    few = float(stdtrit(freedom, 0.975)) / 1.96
    return replace(fit, C=fit.C + few**2 * steps.T @ steps / (sizes * freedom))


def _refitted(linear: LinearModel, left_out: Codes, fit: Fit) -> Array:
    """The step (c,) of a linear model without the rows of a fold."""
    theirs = residual_indices(left_out, fit.residuals.block)
    return refit_of_fold(linear, linear.r, np.arange(linear.K.shape[1]), theirs)[0]


def _fold_estimate(
    model: Fit, calibrated: Fit, left_out: Codes, linear: LinearModel, effects: Sequence[Effect],
    columns: Sequence[Array],
) -> Array:  # fmt: skip
    """The parameters (k,) of the model as one fold has them; further arguments from `NestedSelection.fitted_sets`."""
    step = _refitted(linear, left_out, calibrated)
    x = model.x.copy()
    x[: len(calibrated.x)] = calibrated.x + linear.basis @ step
    moved: dict[tuple[str, str], Array] = {}
    first = len(step) - sum(B.shape[1] for B in columns)
    for effect, B in zip(effects, columns, strict=True):
        norms = np.linalg.norm(B, axis=0)
        one = B @ (step[first : first + B.shape[1]] / np.where(norms > 0, norms, 1.0))
        moved[effect.kind, effect.target] = moved.get((effect.kind, effect.target), 0.0) + one
        first += B.shape[1]
    for i, effect in enumerate(model.effects):
        _set_parameters(model, i, moved[effect.kind, effect.target], x)
    return x


def _set_parameters(model: Fit, place: int, moved: Array, x: Array) -> None:
    """Writes into x (k,) the size and shape of an effect that moves the residuals most like ``moved`` (m,)."""
    part, shape = model.slices[place], model.shapes.get(place)
    own = [*range(part.start, part.stop), *([] if shape is None else [shape])]
    J = model.jacobian[:, own]
    norms = np.linalg.norm(J, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    found = np.linalg.lstsq(J / scale, moved[: len(J)], rcond=_RANK_TOLERANCE)[0] / scale
    sizes = part.stop - part.start
    x[part] = found[:sizes]
    if shape is not None:
        x[shape] = model.x[shape] + found[sizes]
