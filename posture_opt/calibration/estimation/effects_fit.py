"""``fit_with_effects``: geometry and effects of an arm estimated together, shapes included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.calibration.estimation.clustered_covariance import design_effect
from posture_opt.calibration.estimation.fit import (
    MAX_OUTLIER_ROUNDS,
    PRIOR_WEIGHT_TOLERANCE,
    ROUNDING_SHARE,
    Fit,
    estimate_parameters,
    with_clustered_errors,
)
from posture_opt.calibration.estimation.prior import Prior
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.numerics import Array

if TYPE_CHECKING:
    from posture_opt.model.effects import Effect

_EFFECT_OFFSET_TOLERANCE = (
    1e-6  # of a standard error: lines of one joint that lean on each other would not fit any more
)


def fit_with_effects(
    residuals: Residuals, x0: Array, directions: Array, effects: Sequence[Effect], prior: Prior | None = None,
    weight: float = 1.0, *, shapes: bool = True,
) -> Fit:  # fmt: skip
    """Geometry in some ``directions`` (k, r) about ``x0`` (k,), effects and their smooth shapes, all together.

    Rows are taken as independent at first, and then for as many as the design effect of what is left says. What
    effects explain makes data worth more than they were without: the prior is weighed anew.

    Args:
        effects: the fit starts at their shapes, and at their estimates where they have some.
        shapes: whether smooth shapes are fitted too; else they stay.
    """
    wide = residuals.with_effects(effects, x0)
    more = len(wide.parameters) - len(x0)
    steps = np.zeros((len(wide.parameters), directions.shape[1] + more))
    steps[: len(x0), : directions.shape[1]] = directions
    start = np.r_[x0, wide.start_of(effects)]
    steps[len(x0) :, directions.shape[1] :] = np.diag(_unit_steps(wide, start, len(x0)))
    if not shapes:
        held = [i for i, p in enumerate(wide.parameters) if p.name in wide.arm.shape_parameters]
        steps = steps[:, ~np.any(steps[held], axis=0)]
    design, near = 1.0, None
    for _ in range(MAX_OUTLIER_ROUNDS):
        found = estimate_parameters(
            wide,
            start,
            steps,
            prior,
            robust=False,
            near=near,
            weight=weight,
            design=design,
            tolerance=_EFFECT_OFFSET_TOLERANCE,
        )
        again = _design_of_fit(found)
        if prior is None or abs(again - design) <= PRIOR_WEIGHT_TOLERANCE * design:
            break
        design, weight, near = again, found.weight, found.minimum.x
    found = replace(found, design=again, C=found.C / design, effects=wide.fitted_effects(effects, found.x))
    return with_clustered_errors(found) if again > 1 else found


def _unit_steps(wide: Residuals, start: Array, first: int) -> Array:
    """Steps (e,) of the effects' parameters whose columns have length one: scaled so, no unit dominates.

    A column that is rounding, as of an axis that was not measured, has a step of zero: its parameter stays. One that is
    zero is that of a shape of an effect without size, which is still to come.
    """
    norms = np.linalg.norm(wide.residuals_and_jacobian(start)[1][:, first:], axis=0)
    steps = np.where(norms > 0, 1 / np.where(norms > 0, norms, 1.0), 1.0)
    return np.asarray(np.where((norms > 0) & (norms < ROUNDING_SHARE * norms.max(initial=0.0)), 0.0, steps))


def _design_of_fit(fit: Fit) -> float:
    """The design effect of what a fit leaves; 1 where there are hardly more residuals than unknowns."""
    if not fit.directions.shape[1]:
        return 1.0
    A = fit.jacobian @ fit.directions
    norms = np.linalg.norm(A, axis=0)
    return design_effect(fit.residuals, fit.whitened, A / np.where(norms > 0, norms, 1.0))
