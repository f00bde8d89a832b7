"""The arm with effects fitted to measurements: geometry, effects and their shapes together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from posture_opt.calibration.calibration import Calibration
from posture_opt.calibration.clustered_covariance import clustered, design_effect
from posture_opt.calibration.effect_sensitivities import EffectSensitivities
from posture_opt.calibration.estimation import FAIR, ROUNDS, known_rows, variance_of
from posture_opt.calibration.least_squares import Fit, least_squares
from posture_opt.calibration.residuals import Residuals
from posture_opt.diagnosis.candidates import Candidate
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, Codes

_STEP = 1e-3  # of a shape: where its derivative is taken by differences
_LIMIT = {True: 0.3, False: 0.02}  # of a step of a relative shape, and of one in its own unit


@dataclass(frozen=True, eq=False)
class Extended:
    """The estimate of geometry ``x`` (k,) and effects ``theta``, with everything that a prediction needs.

    Args:
        directions: (k, g) steps of the geometry that were fitted.
        suspects: the effects, columns as of ``residuals``; ``theta`` in their order, one parameter after the other.
        covariance: of (g directions, theta, shapes) in that order, residual variance included.
        variance: residual variance in units of the instrument's.
        known: (p, k) weighted rows ``known @ x`` that the fit had of stated σ's besides the measurements.
        design: how many rows tell as much as one alone would, as neighbouring postures err alike.
    """

    residuals: Residuals
    x: Array
    directions: Array
    suspects: tuple[Candidate, ...]
    theta: Array
    covariance: Array
    variance: float
    known: Array
    design: float = 1.0

    @property
    def columns(self) -> Array:
        """(m, parameters) of all effects."""
        m = len(self.residuals.data) * self.residuals.block
        return np.concatenate([np.zeros((m, 0)), *(s.Z for s in self.suspects)], axis=1)

    @property
    def slices(self) -> tuple[slice, ...]:
        """Where in ``theta`` each effect stands."""
        edges = np.cumsum([0, *(s.Z.shape[1] for s in self.suspects)])
        return tuple(slice(int(a), int(b)) for a, b in pairwise(edges))

    @property
    def std(self) -> Array:
        """Standard errors of ``theta``."""
        g = self.directions.shape[1]
        part = np.diag(self.covariance)[g : g + len(self.theta)]
        return np.asarray(np.sqrt(np.maximum(part, 0.0)))

    @property
    def shape_std(self) -> dict[int, float]:
        """Standard error of the shape of each effect that has a smooth one, of its logarithm where it is relative."""
        smooth = [i for i, s in enumerate(self.suspects) if _smooth(s.what)]
        variance = np.diag(self.covariance)[self.directions.shape[1] + len(self.theta) :]
        return {i: float(np.sqrt(max(v, 0.0))) for i, v in zip(smooth, variance, strict=False)}

    def effects(self) -> tuple[Effect, ...]:
        """The named effects with their estimates."""
        return tuple(
            s.what.with_estimate(self.theta[part].tolist())
            for s, part in zip(self.suspects, self.slices, strict=True)
            if isinstance(s.what, Effect)
        )

    def whitened(self) -> Array:
        """(m,) whitened residuals of the rows."""
        rows = len(self.residuals.data) * self.residuals.block
        return np.asarray(self.residuals.whitened(self.x)[:rows] + self.columns @ self.theta)


def fit_calibrated(residuals: Residuals, calibration: Calibration, suspects: Sequence[Candidate]) -> Extended:
    """The arm with effects as `calibrate` fits it without: what is known of it beforehand weighs as much here."""
    known = calibration.beforehand
    if known is None:
        return fit_extended(residuals, calibration.x, calibration.identifiability.directions, suspects)
    weight = known.weight
    for _ in range(ROUNDS):
        rows = known_rows(known.prior, weight, np.eye(len(calibration.x)))
        found = fit_extended(residuals, calibration.x, known.directions, suspects, rows, weight)
        # What effects explain makes data worth more than they were to the calibration.
        fair = float(np.sqrt(found.design * found.variance))
        if abs(weight - fair) <= FAIR * fair:
            break
        weight = fair
    return found


def fit_extended(
    residuals: Residuals, x0: Array, directions: Array, suspects: Sequence[Candidate], known: Array | None = None,
    weight: float = 1.0,
) -> Extended:  # fmt: skip
    """Least squares in geometry, effects and shapes; effects act to first order, as they are small.

    The second order of a joint error of 1 mrad at 1 m is half a micrometre. ``known`` (p, k) are rows of a prior
    of the geometry, times the standard deviation ``weight``.
    """
    known = np.zeros((0, len(x0))) if known is None else known
    tangents = EffectSensitivities(residuals, x0)
    m, g = len(residuals.data) * residuals.block, directions.shape[1]
    smooth = [(i, _effect(s).shape[0]) for i, s in enumerate(suspects) if _smooth(s.what)]
    current = list(suspects)
    x, theta = x0.copy(), np.zeros(sum(s.Z.shape[1] for s in suspects))
    if g + len(theta) == 0:
        variance = float(np.mean(residuals.whitened(x0)[:m] ** 2))
        return Extended(residuals, x, directions, (), theta, np.zeros((0, 0)), variance, known)
    for _ in range(4 if smooth else 1):
        shape_columns = _shape_columns(tangents, current, theta, smooth)
        columns = np.concatenate([*(s.Z for s in current), shape_columns], axis=1)
        function = _Linear(residuals, x0, directions, columns, known)
        away = np.linalg.lstsq(directions, x - x0, rcond=None)[0]
        start = np.concatenate([away, theta, np.zeros(shape_columns.shape[1])])
        found = least_squares(function, start, tolerance=1e-4, max_steps=60)
        x, steps = x0 + directions @ found.x[:g], found.x[g + len(theta) :]
        theta = found.x[g : g + len(theta)]
        if len(steps):
            current = _reshaped(tangents, current, smooth, steps)
    if smooth:  # the last step of the shapes came after the rest: what hangs together closely would not fit any more
        x, theta = _settled(
            _Linear(residuals, x, directions, np.concatenate([s.Z for s in current], axis=1), known), theta
        )
    variance, covariance, design = _errors(function, found, weight)
    return Extended(residuals, x, directions, tuple(current), theta, covariance, variance, known, design)


def _errors(function: _Linear, found: Fit, weight: float) -> tuple[float, Array, float]:
    """Residual variance, covariance of all that was fitted, and design effect of what is left."""
    residuals, known = function.residuals, function.known
    wide = np.zeros((len(known), len(found.x)))
    wide[:, : function.directions.shape[1]] = known @ function.directions
    variance = variance_of(found, wide) if len(known) else found.variance
    A = function(found.x)[1][: len(function.columns)]
    r = found.residuals[: len(A)]
    norms = np.linalg.norm(A, axis=0)
    design = design_effect(residuals, r, A / np.where(norms > 0, norms, 1.0))
    if design > 1:
        return variance, clustered(residuals, r, A, found.R, variance, wide, weight), design
    return variance, found.covariance * (variance / found.variance if len(known) else 1.0), design


@dataclass(frozen=True, eq=False)
class _Linear:
    """Whitened residuals and their Jacobian at (geometry, coefficients of the ``columns`` (m, c)), prior at the end."""

    residuals: Residuals
    x0: Array
    directions: Array
    columns: Array
    known: Array

    def __call__(self, z: Array) -> tuple[Array, Array]:
        m, g = len(self.columns), self.directions.shape[1]
        r, J = with_known(self.residuals, self.x0 + self.directions @ z[:g], self.known)
        r[:m] += self.columns @ z[g:]
        wide = np.concatenate([self.columns, np.zeros((len(r) - m, self.columns.shape[1]))])
        return r, np.concatenate([J @ self.directions, wide], axis=1)


def with_known(residuals: Residuals, x: Array, known: Array) -> tuple[Array, Array]:
    """Whitened residuals and their Jacobian at ``x`` with those of a prior ``known`` (p, k) at the end."""
    r, J = residuals.both(x)
    if not len(known):
        return r.copy(), J
    return np.concatenate([r, known @ x]), np.concatenate([J, known])


def _reshaped(
    tangents: EffectSensitivities, suspects: Sequence[Candidate], smooth: Sequence[tuple[int, str]], steps: Array
) -> list[Candidate]:
    """The suspects with their shapes moved by ``steps`` (of relative ones the logarithm), not too far at once."""
    moved = list(suspects)
    for (i, name), step in zip(smooth, steps, strict=True):
        effect = _effect(suspects[i])
        value, limit = float(getattr(effect, name)), _LIMIT[effect.relative_shape]
        value += float(np.clip(step, -limit, limit)) * (value if effect.relative_shape else 1.0)
        what = effect.with_shape(value)
        moved[i] = Candidate(what, tangents.columns(what), suspects[i].searched)
    return moved


def _settled(function: _Linear, theta: Array) -> tuple[Array, Array]:
    """Geometry and effects with the shapes as they are: one step to the minimum, next to which they stand."""
    g = function.directions.shape[1]
    r, A = function(np.r_[np.zeros(g), theta])
    scale = np.linalg.norm(A, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    step = np.linalg.lstsq(A / scale, -r, rcond=1e-10)[0] / scale
    return function.x0 + function.directions @ step[:g], theta + step[g:]


def _effect(suspect: Candidate) -> Effect:
    assert isinstance(suspect.what, Effect)
    return suspect.what


def _smooth(what: object) -> bool:
    return isinstance(what, Effect) and bool(what.smooth_shape)


def _shape_columns(
    tangents: EffectSensitivities, suspects: Sequence[Candidate], theta: Array, smooth: Sequence[tuple[int, str]]
) -> Array:
    """(m, shapes) derivative of the effects by their shapes: by the logarithm of relative ones."""
    m = tangents.rows
    if not np.any(theta):
        return np.zeros((m, 0))
    columns = []
    edges = np.cumsum([0, *(s.Z.shape[1] for s in suspects)])
    for i, name in smooth:
        effect = _effect(suspects[i])
        value = float(getattr(effect, name))
        step = _STEP * value if effect.relative_shape else _STEP
        more = tangents.columns(effect.with_shape(value + step))
        less = tangents.columns(effect.with_shape(value - step))
        columns.append((more - less) @ theta[edges[i] : edges[i + 1]] / (2 * _STEP))
    return np.stack(columns, axis=1) if columns else np.zeros((m, 0))


def shape_column(tangents: EffectSensitivities, suspect: Candidate, theta: Array) -> Array:
    """(m, 0 or 1) derivative of an effect of size theta by its shape, where it has a smooth one."""
    smooth = [(0, _effect(suspect).shape[0])] if _smooth(suspect.what) else []
    return _shape_columns(tangents, [suspect], theta, smooth) if smooth else np.zeros((tangents.rows, 0))


def taken(extended: Extended, rows: Codes) -> Extended:
    """The same estimate seen in some rows."""
    residuals = extended.residuals
    index = (rows[:, None] * residuals.block + np.arange(residuals.block)).ravel()
    suspects = tuple(Candidate(s.what, s.Z[index], s.searched) for s in extended.suspects)
    return replace(extended, residuals=residuals.take(rows), suspects=suspects)
