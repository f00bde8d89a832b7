"""Geometry as a cause: few wrong parameters are named one by one, many are calibrated together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from posture_opt.calibration.assumptions.contradictions import GeometricDeviation
from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.cross_validation import Folds, LinearModel, leave_out
from posture_opt.calibration.estimation.fit import Fit, fit_with_effects
from posture_opt.calibration.estimation.parameters import Parameter, Prior, known_rows
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.diagnosis.causes.causes import Finding
from posture_opt.diagnosis.scores import levels
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, rms_length

CERTAIN = 1.96  # standard errors that a certain difference has, at 95 %


def geometry_causes(
    residuals: Residuals, x_frames: Array, free: Array, full: Fit, effects: Sequence[Effect], folds: Folds,
    estimated: Estimated | None = None,
) -> list[Finding]:  # fmt: skip
    """The geometric causes in addition to the effects: up to three parameters by name, or all of them together.

    Forward selection of single parameters, each the one of largest gain, until the F test of all other geometry is no
    longer significant. What held-out rows do not need is no cause.

    Args:
        x_frames: (k,) parameters with only the free frames fitted [SI].
        free: (k, f) directions of the free frames and touched points.
    """
    fits = _FewParameters(residuals, x_frames, free, effects, full, estimated or Estimated())
    nominal = fits.with_only(())
    p = _f_test(nominal, full)
    if p > levels.GEOMETRY_LEVEL:
        return []
    chosen: list[int] = []
    while len(chosen) < 3:  # with more, "many parameters"
        gains = _gains_alone(fits.with_only(chosen), [i for i in fits.others if i not in chosen])
        if not gains:
            break
        chosen.append(max(gains, key=lambda i: gains[i]))
        if _f_test(fits.with_only(chosen), full) > levels.GEOMETRY_LEVEL:
            return _single_causes(fits, chosen, folds)
    gain = _gain(full, nominal, folds)
    return [Finding(GeometricDeviation.of_all(), {}, p, gain)] if gain > 0 else []


@dataclass(frozen=True, eq=False)
class Estimated:
    """Parameters that were calibrated before, by their ``places``, and the covariance (p, p) of their estimates."""

    places: tuple[int, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def without(self, places: Sequence[int]) -> Estimated:
        kept = [k for k, place in enumerate(self.places) if place not in places]
        return Estimated(tuple(self.places[k] for k in kept), self.covariance[np.ix_(kept, kept)])


@dataclass(frozen=True, eq=False)
class _FewParameters:
    """Fits of an arm with free frames, effects and some parameters, other geometry as in the file; each made once."""

    residuals: Residuals
    x_frames: Array
    free: Array
    effects: Sequence[Effect]
    full: Fit
    estimated: Estimated
    _made: dict[tuple[int, ...], Fit] = field(default_factory=dict)

    @property
    def others(self) -> list[int]:
        return [i for i in range(len(self.x_frames)) if not np.any(self.free[i])]

    def with_only(self, chosen: Sequence[int]) -> Fit:
        key = tuple(chosen)
        if key not in self._made:
            known = self.estimated.without([*chosen, *np.flatnonzero(np.any(self.free, axis=1))])
            # Of the free frames, and of single parameters by a mm or mrad, near one unit of the other directions.
            places = [*chosen, *known.places]
            single = np.zeros((len(self.x_frames), len(places)))
            single[places, range(len(places))] = 1e-3
            directions = np.concatenate([self.free, single], axis=1)
            prior = Prior.of(list(known.places), known.covariance) if known.places else None
            self._made[key] = fit_with_effects(
                self.residuals,
                self.x_frames,
                directions,
                self.effects,
                prior,
                float(np.sqrt(self.full.variance)),
                shapes=False,
            )
        return self._made[key]


def _gain(model: Fit, without: Fit, folds: Folds) -> float:
    most, least = (
        rms_length(leave_out(fit.residuals, LinearModel.of(fit), folds, []).whole) for fit in (without, model)
    )
    return 1 - least / max(most, 1e-300)


def _sum_of_squares(model: Fit) -> float:
    r = np.concatenate([model.whitened, _known(model) @ model.x])
    return float(r @ r)


def _known(model: Fit) -> Array:
    """(p, k) rows of the former estimates that a model keeps to."""
    return known_rows(model.prior, model.weight, np.eye(len(model.x)))


def _f_test(small: Fit, large: Fit) -> float:
    """p-value of the F test of the parameters that only the large model has.

    ``F = ((SS_s − SS_l) / k) / (SS_l / ν)`` with the k further parameters and ν degrees of freedom of the large model.
    What was estimated before is a row of both, so that the errors of these estimates are no deviation.
    """
    from scipy.special import fdtrc

    more = sum(
        sign * (len(fit.geometry) - (0 if fit.prior is None else len(fit.prior.rows)))
        for sign, fit in ((1, large), (-1, small))
    )
    m = len(large.residuals.data) * large.residuals.block
    left = m - large.count
    if more <= 0 or left <= 0:
        return 1.0
    gain = max(_sum_of_squares(small) - _sum_of_squares(large), 0.0)
    return float(fdtrc(more, left, gain / more / (_sum_of_squares(large) / left)))


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
        if np.linalg.norm(rest) > max(1e-3 * most[residuals.parameters[i].unit], 1e-300):
            gains[i] = float((rest @ r) ** 2 / (rest @ rest))
    return gains


def _single_causes(fits: _FewParameters, chosen: Sequence[int], folds: Folds) -> list[Finding]:
    """The chosen parameters as causes; without the one that held-out rows need least, if they do not need it."""
    fitted = fits.with_only(chosen)
    without = [fits.with_only([j for j in chosen if j != i]) for i in chosen]
    gains = [_gain(fitted, other, folds) for other in without]
    worst = int(np.argmin(gains)) if gains else 0
    if gains and gains[worst] <= 0:
        return _single_causes(fits, [*chosen[:worst], *chosen[worst + 1 :]], folds)
    others = [j for j in fits.others if j not in chosen]
    limit = _sum_of_squares(fitted) * np.exp(levels.RIVAL_CRITERION / len(fitted.whitened))
    found = []
    for i, other, gain in zip(chosen, without, gains, strict=True):
        parameter, alone = fits.residuals.parameters[i], _gains_alone(other, others)
        own = GeometricDeviation.of(parameter)
        near = [j for j in alone if _sum_of_squares(other) - alone[j] <= limit]
        rivals = dict.fromkeys(GeometricDeviation.of(fits.residuals.parameters[j]) for j in near)
        estimate = {parameter.name.rpartition(".")[2]: (float(fitted.x[i]), float(fitted.std[i]), parameter.unit)}
        alike = tuple(r for r in rivals if r != own)
        found.append(Finding.independent(own, estimate, _f_test(other, fitted), gain, alike))
    return found


@dataclass(frozen=True)
class Correction:
    """One geometric parameter of the fitted arm.

    Args:
        parameter: of the arm; ``value`` what it differs from the file by [rad or m], ``std`` its standard error.
    """

    parameter: Parameter
    value: float
    std: float

    @property
    def certain(self) -> bool:
        return abs(self.value) > CERTAIN * self.std

    @property
    def excess(self) -> float:
        """Times the tolerance of new arms, 5 mm or mrad by choice, that it is off at the least, within its error."""
        return (abs(self.value) - CERTAIN * self.std) / 5e-3

    @property
    def is_zero(self) -> bool:
        """Whether it is the zero of a joint, which is set and no part."""
        return self.parameter.name.endswith(".theta")


def determined_corrections(calibration: Calibration, model: Fit) -> tuple[Correction, ...]:
    """The geometric parameters of the arm with its effects that the data determine."""
    rows = zip(calibration.parameters, model.x, model.std, calibration.std, model.held_by_prior, strict=False)
    return tuple(
        Correction(p, float(x), float(std))
        for p, x, std, whole, held in rows
        if p.group == "geometry"
        and 0 < whole < 10 * std  # what the data leave open has a small part in what they determine
        and held < 3  # no tolerance of parts decides which of two lengths it is that act alike
    )
