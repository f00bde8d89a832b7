"""Geometry as a cause: few wrong parameters are named one by one, many are calibrated together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.calibration.estimation.fit import Fit, fit_with_effects
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.diagnosis.scores import levels
from posture_opt.model.effects import Cause, Effect
from posture_opt.numerics import Array

_DEPENDENCE_TOLERANCE = 1e-4  # of a column: what other columns leave of it by rounding and linearisation
_COMBINATION_SCALE = 1e-3  # a mm, a mrad: near one unit of the other directions


@dataclass(frozen=True, eq=False)
class GeometryCause:
    """A geometric cause that is named, with its size where it is a single parameter.

    Args:
        deviation: which parameter or frame; ``geometry`` of many together.
        estimate: parameter -> (deviation from the file, standard error, SI unit); empty of many.
        p_value: of the F test of the parameters that only the larger model has.
        confounded_with: parameters that explain as much in its place.
    """

    deviation: GeometricDeviation
    estimate: Mapping[str, tuple[float, float, str]]
    p_value: float
    confounded_with: tuple[Cause, ...] = ()


def geometry_causes(
    residuals: Residuals, x_frames: Array, free: Array, full: Fit, effects: Sequence[Effect]
) -> list[GeometryCause]:
    """The geometric causes in addition to the effects: up to three parameters by name, or all of them together.

    Forward selection of single parameters, each the one of largest gain, until the F test of all other geometry is no
    longer significant; `levels.MAX_NAMED_PARAMETERS` at the most.

    Args:
        x_frames: (k,) parameters with only the free frames fitted [SI].
        free: (k, f) directions of the free frames and touched points.
        full: the model with all geometry fitted.
        effects: those of the model; their shapes stay as they are there.

    Returns:
        Empty where the F test of all geometry is not significant at `levels.GEOMETRY_LEVEL`.
    """
    nominal = fit_with_effects(residuals, x_frames, free, effects, shapes=False)
    p = _f_test(nominal, full)
    if p > levels.GEOMETRY_LEVEL:
        return []
    few = _few_parameters(residuals, x_frames, free, full, effects)
    if few is not None:
        return few
    return [GeometryCause(GeometricDeviation.of_all(), {}, p)]


def _sum_of_squares(model: Fit) -> float:
    """Sum of squares of the whitened residuals of a model."""
    r = model.whitened
    return float(r @ r)


def _f_test(small: Fit, large: Fit) -> float:
    """p-value of the F test of the parameters that only the large model has.

    ``F = ((SS_s − SS_l) / k) / (SS_l / ν)`` with the k further parameters and ν degrees of freedom of the large model.
    """
    from scipy.special import fdtrc

    more = len(large.geometry) - len(small.geometry)
    m = len(large.residuals.data) * large.residuals.block
    left = m - large.count
    if more <= 0 or left <= 0:
        return 1.0
    gain = max(_sum_of_squares(small) - _sum_of_squares(large), 0.0)
    return float(fdtrc(more, left, gain / more / (_sum_of_squares(large) / left)))


def _few_parameters(
    residuals: Residuals, x_frames: Array, free: Array, full: Fit, effects: Sequence[Effect]
) -> list[GeometryCause] | None:
    """The fewest parameters given which the others add nothing significant; None where that takes more than three."""
    chosen: list[int] = []
    model = fit_with_effects(residuals, x_frames, free, effects, shapes=False)
    frames = {i for i in range(len(x_frames)) if np.any(free[i])}
    while len(chosen) < levels.MAX_NAMED_PARAMETERS:
        gains = _gains_alone(model, [i for i in range(len(x_frames)) if i not in chosen and i not in frames])
        if not gains:
            return None
        chosen.append(max(gains, key=lambda i: gains[i]))
        model = fit_with_effects(
            residuals, x_frames, _with_parameters(free, chosen, len(x_frames)), effects, shapes=False
        )
        if _f_test(model, full) > levels.GEOMETRY_LEVEL:
            return _single_causes(residuals, x_frames, free, model, chosen, effects)
    return None


def _with_parameters(free: Array, chosen: Sequence[int], k: int) -> Array:
    """Directions (k, f + c) of the free frames, and of single parameters in addition."""
    single = np.zeros((k, len(chosen)))
    single[list(chosen), range(len(chosen))] = _COMBINATION_SCALE
    return np.concatenate([free, single], axis=1)


def _gains_alone(model: Fit, candidates: Sequence[int]) -> dict[int, float]:
    """Drop of the sum of squares by each parameter alone, to first order about a model.

    ``(zᵀ r)² / zᵀ z`` with the column z of the parameter projected off all that the model fits. A column that is all
    but gone, or tiny next to others of its unit, is no candidate.
    """
    residuals = model.residuals
    rows = len(residuals.data) * residuals.block
    r = model.whitened
    J = model.jacobian
    A = np.concatenate([J @ model.directions[:, model.geometry], J[:, model.sizes]], axis=1)
    norms = np.linalg.norm(A, axis=0)
    Q = np.linalg.qr(A / np.where(norms > 0, norms, 1.0))[0] if A.shape[1] else np.zeros((rows, 0))
    J = J[:, : len(J.T) - len(model.sizes) - len(model.shapes)]
    lengths = np.linalg.norm(J, axis=0)
    most = {p.unit: max(n for o, n in zip(residuals.parameters, lengths, strict=False) if o.unit == p.unit)
            for p in residuals.parameters[: len(lengths)]}  # fmt: skip
    gains = {}
    for i in candidates:
        column = J[:, i]
        rest = column - Q @ (Q.T @ column)
        # A tilt of a planar arm out of its plane acts in the plane to second order only: no cause to first order.
        if np.linalg.norm(rest) > max(
            _DEPENDENCE_TOLERANCE * lengths[i], levels.MIN_PARAMETER_SHARE * most[residuals.parameters[i].unit], 1e-300
        ):
            gains[i] = float((rest @ r) ** 2 / (rest @ rest))
    return gains


def _single_causes(
    residuals: Residuals, x_frames: Array, free: Array, model: Fit, chosen: list[int],
    effects: Sequence[Effect],
) -> list[GeometryCause]:  # fmt: skip
    """The chosen parameters as causes: deviation, F test of each given the others, and its rivals."""
    causes = []
    rss, m = _sum_of_squares(model), len(residuals.data) * residuals.block
    for i in chosen:
        rest = [j for j in chosen if j != i]
        without = fit_with_effects(
            residuals, x_frames, _with_parameters(free, rest, len(x_frames)), effects, shapes=False
        )
        others = _gains_alone(without, [j for j in range(len(x_frames)) if j not in chosen and not np.any(free[j])])
        limit = rss * np.exp(levels.RIVAL_CRITERION / m)
        rivals = [
            GeometricDeviation.of(residuals.parameters[j])
            for j, gain in others.items()
            if _sum_of_squares(without) - gain <= limit
        ]
        parameter = residuals.parameters[i]
        own = GeometricDeviation.of(parameter)
        deviation = float(model.x[i] - x_frames[i]) + float(x_frames[i])
        std = float(model.std[i])
        estimate = {parameter.name.rpartition(".")[2]: (deviation, std, parameter.unit)}
        others_alike = tuple(dict.fromkeys(r for r in rivals if r != own))
        causes.append(GeometryCause(own, estimate, _f_test(without, model), others_alike))
    return causes
