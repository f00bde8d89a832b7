"""Geometry as a cause: few wrong parameters are named one by one, many are calibrated together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from posture_opt.calibration.assumptions.geometric_deviation import GeometricDeviation
from posture_opt.calibration.cross_validation import Folds
from posture_opt.calibration.estimation.effects_fit import fit_with_effects
from posture_opt.calibration.estimation.fit import Fit
from posture_opt.calibration.estimation.linear_model import LinearModel
from posture_opt.calibration.estimation.prior import Prior, known_rows
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.calibration.leave_out import leave_out
from posture_opt.diagnosis.scores import levels
from posture_opt.model.effects import Cause, Effect
from posture_opt.numerics import Array, rms_length

_DEPENDENCE_TOLERANCE = 1e-4  # of a column: what other columns leave of it by rounding and linearisation
_COMBINATION_SCALE = 1e-3  # a mm, a mrad: near one unit of the other directions


@dataclass(frozen=True, eq=False)
class GeometryCause:
    """A geometric cause that is named, with its size where it is a single parameter.

    Args:
        deviation: which parameter or frame; ``geometry`` of many together.
        estimate: parameter -> (deviation from the file, standard error, SI unit); empty of many.
        p_value: of the F test of the parameters that only the larger model has.
        gain: relative drop of the RMS of held-out rows by it, everything else of its model fitted again without it.
        confounded_with: parameters that explain as much in its place.
    """

    deviation: GeometricDeviation
    estimate: Mapping[str, tuple[float, float, str]]
    p_value: float
    gain: float
    confounded_with: tuple[Cause, ...] = ()


def geometry_causes(
    residuals: Residuals, x_frames: Array, free: Array, full: Fit, effects: Sequence[Effect], folds: Folds,
    estimated: Estimated | None = None,
) -> list[GeometryCause]:  # fmt: skip
    """The geometric causes in addition to the effects: up to three parameters by name, or all of them together.

    Forward selection of single parameters, each the one of largest gain, until the F test of all other geometry is no
    longer significant; `levels.MAX_NAMED_PARAMETERS` at the most. A parameter that is named is left out of the model
    of those that are, in which all other geometry is as in the file; geometry that is not, of that of all. What
    held-out rows do not need is no cause.

    Args:
        x_frames: (k,) parameters with only the free frames fitted [SI].
        free: (k, f) directions of the free frames and touched points.
        full: the model with all geometry fitted.
        effects: those of the model; their shapes stay as they are there.
        folds: the rows that each round leaves out.
        estimated: what the file has as estimates of an earlier calibration: within their errors they are as in the
            file.

    Returns:
        Empty where the F test of all geometry is not significant at `levels.GEOMETRY_LEVEL`.
    """
    fits = _FewParameters(residuals, x_frames, free, effects, full, estimated or Estimated())
    nominal = fits.with_only(())
    p = _f_test(nominal, full)
    if p > levels.GEOMETRY_LEVEL:
        return []
    few = _needed_parameters(fits, full)
    if few is not None:
        return _single_causes(fits, few, folds)
    gain = _gain(full, nominal, folds)
    return [GeometryCause(GeometricDeviation.of_all(), {}, p, gain)] if gain > 0 else []


@dataclass(frozen=True, eq=False)
class Estimated:
    """Parameters that were calibrated before, by their ``places``, and the covariance (p, p) of their estimates."""

    places: tuple[int, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def without(self, places: Sequence[int]) -> Estimated:
        """The others, whatever those are."""
        kept = [k for k, place in enumerate(self.places) if place not in places]
        return Estimated(tuple(self.places[k] for k in kept), self.covariance[np.ix_(kept, kept)])


@dataclass(frozen=True, eq=False)
class _FewParameters:
    """Fits of an arm with free frames, effects and some parameters, all other geometry as in the file; each made once.

    Args:
        residuals, x_frames, free, effects, full, estimated: as of `geometry_causes`.
    """

    residuals: Residuals
    x_frames: Array
    free: Array
    effects: Sequence[Effect]
    full: Fit
    estimated: Estimated
    _made: dict[tuple[int, ...], Fit] = field(default_factory=dict)

    @property
    def others(self) -> list[int]:
        """The parameters that are not of free frames."""
        return [i for i in range(len(self.x_frames)) if not np.any(self.free[i])]

    def with_only(self, chosen: Sequence[int]) -> Fit:
        """The one with so many single parameters."""
        key = tuple(chosen)
        if key not in self._made:
            known = self.estimated.without([*chosen, *np.flatnonzero(np.any(self.free, axis=1))])
            directions = _with_parameters(self.free, [*chosen, *known.places], len(self.x_frames))
            prior = Prior.of(list(known.places), known.covariance) if known.places else None
            self._made[key] = fit_with_effects(
                self.residuals, self.x_frames, directions, self.effects, prior, self._spread, shapes=False
            )
        return self._made[key]

    @property
    def _spread(self) -> float:
        """The standard deviation of what all geometry leaves, in units of the instrument's."""
        return float(np.sqrt(self.full.variance))


def _gain(model: Fit, without: Fit, folds: Folds) -> float:
    """Relative drop of the RMS of held-out rows from a model without something to one with it."""
    most, least = (
        rms_length(leave_out(fit.residuals, LinearModel.of(fit), folds, []).whole) for fit in (without, model)
    )
    return 1 - least / max(most, 1e-300)


def _sum_of_squares(model: Fit) -> float:
    """Sum of squares of the whitened residuals of a model, and of how far it is from former estimates."""
    r = np.concatenate([model.whitened, _known(model) @ model.x])
    return float(r @ r)


def _known(model: Fit) -> Array:
    """(p, k) rows of the former estimates that a model keeps to."""
    return known_rows(model.prior, model.weight, np.eye(len(model.x)))


def _freed(model: Fit) -> int:
    """How many directions of the geometry nothing is known of."""
    return len(model.geometry) - (0 if model.prior is None else len(model.prior.rows))


def _f_test(small: Fit, large: Fit) -> float:
    """p-value of the F test of the parameters that only the large model has.

    ``F = ((SS_s − SS_l) / k) / (SS_l / ν)`` with the k further parameters and ν degrees of freedom of the large model.
    What was estimated before is a row of both, so that the errors of these estimates are no deviation.
    """
    from scipy.special import fdtrc

    more = _freed(large) - _freed(small)
    m = len(large.residuals.data) * large.residuals.block
    left = m - large.count
    if more <= 0 or left <= 0:
        return 1.0
    gain = max(_sum_of_squares(small) - _sum_of_squares(large), 0.0)
    return float(fdtrc(more, left, gain / more / (_sum_of_squares(large) / left)))


def _needed_parameters(fits: _FewParameters, full: Fit) -> list[int] | None:
    """The fewest parameters given which the others add nothing significant; None where that takes more than three."""
    chosen: list[int] = []
    while len(chosen) < levels.MAX_NAMED_PARAMETERS:
        gains = _gains_alone(fits.with_only(chosen), [i for i in fits.others if i not in chosen])
        if not gains:
            return None
        chosen.append(max(gains, key=lambda i: gains[i]))
        if _f_test(fits.with_only(chosen), full) > levels.GEOMETRY_LEVEL:
            return chosen
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
    known = _known(model)
    r = np.concatenate([model.whitened, known @ model.x])
    J = np.concatenate([model.jacobian, known])
    A = np.concatenate([J @ model.directions[:, model.geometry], J[:, model.sizes]], axis=1)
    norms = np.linalg.norm(A, axis=0)
    Q = np.linalg.qr(A / np.where(norms > 0, norms, 1.0))[0] if A.shape[1] else np.zeros((len(J), 0))
    J = J[:, : len(J.T) - len(model.sizes) - len(model.shapes)].copy()
    J[len(model.whitened) :] = 0.0  # one more of the same parameter, of which nothing is known
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


def _single_causes(fits: _FewParameters, chosen: Sequence[int], folds: Folds) -> list[GeometryCause]:
    """The chosen parameters as causes; without the one that held-out rows need least, if they do not need it."""
    fitted = fits.with_only(chosen)
    without = [fits.with_only([j for j in chosen if j != i]) for i in chosen]
    gains = [_gain(fitted, other, folds) for other in without]
    worst = int(np.argmin(gains)) if gains else 0
    if gains and gains[worst] <= 0:
        return _single_causes(fits, [*chosen[:worst], *chosen[worst + 1 :]], folds)
    others = [j for j in fits.others if j not in chosen]
    rows = zip(chosen, without, gains, strict=True)
    return [_single_cause(fitted, other, i, others, gain) for i, other, gain in rows]


def _single_cause(model: Fit, without: Fit, i: int, others: Sequence[int], gain: float) -> GeometryCause:
    """A parameter as a cause: deviation, F test given the others, and its rivals.

    Args:
        model, without: with the parameter i and without it; others: parameters that neither has.
    """
    limit = _sum_of_squares(model) * np.exp(levels.RIVAL_CRITERION / len(model.whitened))
    parameters, own = model.residuals.parameters, GeometricDeviation.of(model.residuals.parameters[i])
    gains = _gains_alone(without, others)
    rivals = (GeometricDeviation.of(parameters[j]) for j in gains if _sum_of_squares(without) - gains[j] <= limit)
    estimate = {parameters[i].name.rpartition(".")[2]: (float(model.x[i]), float(model.std[i]), parameters[i].unit)}
    alike = tuple(dict.fromkeys(r for r in rivals if r != own))
    return GeometryCause(own, estimate, _f_test(without, model), gain, alike)
