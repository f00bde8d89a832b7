"""What a problem states of errors, and the covariance that a model predicts for each measured row."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import NoiseEffect
from posture_opt.numerics import Array, Codes, Mask
from posture_opt.robot.robot import Robot
from posture_opt.selection.problem_data import ProblemData
from posture_opt.uncertainty.sources.repeatability import joint_sigmas
from posture_opt.uncertainty.sources.sources import Sources

_VARIANCE_TOLERANCE = 1e-6  # of a variance
_MIN_SIGMA_M = 1e-8  # m: no instrument is better, and a region without thickness holds nothing


@dataclass(frozen=True)
class JointScatter:
    """Standard deviations of the joints' errors from posture to posture, and the part that is scatter.

    Args:
        sigma: JOINT.theta or JOINT.d -> standard deviation [rad or m], above 0.
        staying: the part of it that is the same at every repeat of a posture: the model errs there.
        of_effects: the part of it that effects of the problem, or effects that were named, say.
        instrument: standard deviation of a measured coordinate [m] that was taken off before.
        measured: whether the data say so; else it is what the problem file states.
        note: a sentence on where it comes from.
    """

    sigma: Mapping[str, float] = field(default_factory=dict)
    instrument: float = 0.0
    measured: bool = False
    note: str = ""
    of_effects: Mapping[str, float] = field(default_factory=dict)
    staying: Mapping[str, float] = field(default_factory=dict)

    @property
    def without_effects(self) -> dict[str, float]:
        """The scatter from repeat to repeat without the part of the effects, where something is left."""
        parts = {
            name: s**2 - self.of_effects.get(name, 0.0) ** 2 - self.staying.get(name, 0.0) ** 2
            for name, s in self.sigma.items()
        }
        return {name: math.sqrt(v) for name, v in parts.items() if v > _VARIANCE_TOLERANCE * self.sigma[name] ** 2}

    @property
    def errors(self) -> Sources:
        """What stays, as unknown errors of the joints."""
        return Sources.independent(self.staying)


def stated_scatter(problem: ProblemData) -> JointScatter:
    """What the problem states of the joints' scatter, without that of its effects.

    In this order: scatter that the file states; σ's of the joints, taken for scatter; the data sheet's repeatability.
    """
    sources, own = problem.sources, scatter_of_effects(problem.robot, problem.effects)
    total = dict(zip(sources.names, map(float, np.sqrt(np.diag(sources.scatter))), strict=True))
    scatter = {name: s for name, s in total.items() if s > 0}
    if scatter:
        return JointScatter(
            JointScatter(scatter, of_effects=own).without_effects,
            note="scatter of the joints as stated: the data do not determine it",
        )
    joints, staying = joint_errors(problem.robot), np.sqrt(np.diag(sources.constant))
    sigma = {name: float(s) for name, s in zip(sources.names, staying, strict=True) if name in joints and s > 0}
    if sigma:
        return JointScatter(
            sigma, note="the σ's of the joints, as stated, taken for their scatter: the data do not determine it"
        )
    sheet = problem.robot.repeatability
    if sheet is not None:
        found = joint_sigmas(problem.robot, sheet.value)
        sigma = dict(zip(found.names, map(float, found.sigma), strict=True))
        return JointScatter(sigma, note="scatter of the joints from the data sheet: the data do not determine it")
    return JointScatter(note="the data show no scatter of the joints, and none is stated")


def scatter_of_effects(robot: Robot, effects: Sequence[object]) -> dict[str, float]:
    """JOINT.theta or JOINT.d -> σ from repeat to repeat that effects state [rad or m].

    Effects that scatter one joint add as independent errors, ``√(Σ σ²)``.
    """
    total: dict[str, float] = {}
    for effect in effects:
        total = added_in_quadrature(total, effect.scatter(robot)) if isinstance(effect, NoiseEffect) else total
    return total


def added_in_quadrature(one: Mapping[str, float], other: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations of independent errors, added by name: ``√(σ_1² + σ_2²)``."""
    return {name: math.hypot(one.get(name, 0.0), other.get(name, 0.0)) for name in (*one, *other)}


def scatter_with_effects(problem: ProblemData, name: str, own: float, said: float) -> float:
    """The σ of a joint from repeat to repeat [rad or m]: what the problem states, with the part of effects replaced.

    Args:
        own: part of the stated σ that is that of effects of the problem.
        said: σ of all effects, of the problem and named in the data.
    """
    variance = dict(zip(problem.sources.names, np.diag(problem.sources.scatter), strict=True)).get(name, 0.0)
    return math.sqrt(max(float(variance) - own**2, 0.0) + said**2)


def joint_errors(robot: Robot) -> tuple[str, ...]:
    """(n,) the names of the joint values' errors, JOINT.theta or JOINT.d."""
    return tuple(robot.factors[i].parameter for i in robot.driven)


@dataclass(frozen=True, eq=False)
class ErrorSources:
    """Errors that stay and errors drawn anew at every repeat, by the parameters of the arm that err.

    Args:
        names: (k,) of the parameters of the arm.
        constant: (k, k) covariance of what stays from repeat to repeat [rad², m²].
        scatter: (k, k) covariance of what does not.
    """

    names: tuple[str, ...]
    constant: Array
    scatter: Array

    @classmethod
    def of(cls, residuals: Residuals, sources: Sources) -> ErrorSources:
        """The sources of a problem that have a variance.

        Args:
            residuals: for the names of the arm's parameters; sources without variance, or of no parameter, are left
                out.
        """
        known = residuals.robot.parameters
        kept = [i for i, name in enumerate(sources.names) if sources.covariance[i, i] > 0 and name in known]
        chosen = np.ix_(kept, kept)
        return cls(tuple(sources.names[i] for i in kept), sources.constant[chosen], sources.scatter[chosen])


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted errors of N rows: ``e_i = A_i δ + v_i``, δ common to all rows and v_i of each repeat its own.

    Args:
        common: (N, d, k) A, each column for a δ of variance one [m].
        scatter: (N, d, d) covariance of v [m²].
    """

    common: Array
    scatter: Array

    @property
    def covariance(self) -> Array:
        """(N, d, d) [m²]."""
        return np.asarray(self.common @ np.swapaxes(self.common, -1, -2) + self.scatter)

    def take(self, rows: Codes) -> Prediction:
        """The prediction of some rows."""
        return Prediction(self.common[rows], self.scatter[rows])


def joint_columns(residuals: Residuals, x: Array) -> Array:
    """(N, d, n) shift of the measured coordinates by a unit of each joint's error [m/rad, m/m].

    Args:
        x: (k,) deviations from nominal [rad, m].
    """
    d = len(residuals.axes)
    return residuals.metres(residuals.sensitivities(residuals.robot.driven, x)[:, :d])


def nominal_prediction(
    residuals: Residuals, x: Array, errors: ErrorSources, instrument: float, folds: Sequence[Codes], kept: Mask
) -> Prediction:
    """The errors that the model predicts before calibration for rows that its free frames were not fitted to.

    With the errors δ that stay, v_i of a repeat and F the columns of what is free (frames, touched points), fitting
    takes ``F (F_t⁺ (B_t δ + v_t))`` off, t the rows of the other folds, so that

    ``e_i = (B_i − F_i F_t⁺ B_t) δ + v_i − F_i F_t⁺ v_t``.

    A base that is free swallows an error of the first joint: without this, a spread that cannot be seen would be
    predicted.

    Args:
        x: (k,) deviations with the free frames fitted.
        instrument: σ of a coordinate [m].
        errors: sources of the problem; folds: rows of each fold; kept: (N,) rows that are no outliers.
    """
    N, d, block = len(residuals.data), len(residuals.axes), residuals.block
    B, F = residuals.sensitivities(errors.names, x), _free_columns(residuals, x)
    V = B @ errors.scatter @ np.swapaxes(B, -1, -2)
    V[:, range(block), range(block)] += np.where(np.arange(block) < d, (instrument / residuals.sigma) ** 2, 1.0)
    root = _full_rank_root(errors.constant)
    common, scatter = np.zeros((N, d, root.shape[1])), np.zeros((N, d, d))
    for left_out in folds:
        train = kept.copy()
        train[left_out] = False
        G = _pseudo_inverse(F[train]).reshape(F.shape[2], int(train.sum()), block)
        Fi = F[left_out][:, :d]
        A = B[left_out][:, :d] - Fi @ np.einsum("pnb,nbk->pk", G, B[train])
        fitted = np.einsum("pnb,nbc,qnc->pq", G, V[train], G, optimize=True)
        common[left_out] = A @ root
        scatter[left_out] = V[left_out][:, :d, :d] + Fi @ fitted @ np.swapaxes(Fi, -1, -2)
    own = _about_points(residuals.data, scatter)
    return Prediction(residuals.metres(common), residuals.metres(residuals.metres(own)))


def calibrated_prediction(
    residuals: Residuals, x: Array, covariance: Array, scatter: Array, instrument: float, taught: float = 1.0
) -> Prediction:
    """Errors ``J C Jᵀ + J_q diag(scatter²) J_qᵀ + s² I`` at rows that a calibration has not seen.

    Args:
        covariance: (k, k) of the parameters, from all rows; from the share ``taught`` of them it is larger.
        scatter: (n,) standard deviations of the joints from repeat to repeat [rad, m].
    """
    common = parameter_columns(residuals, x) @ symmetric_root(covariance / taught)
    return Prediction(common, scatter_covariances(residuals, x, scatter, instrument))


def parameter_columns(residuals: Residuals, x: Array) -> Array:
    """(N, d, k) shift of the measured coordinates by a unit of each parameter; of touched points, about their mean."""
    N, d = len(residuals.data), len(residuals.axes)
    J = residuals.residuals_and_jacobian(x)[1][: N * residuals.block].reshape(N, residuals.block, -1)
    return residuals.data.about_points(residuals.metres(J[:, :d]))


def scatter_covariances(residuals: Residuals, x: Array, scatter: Array, instrument: float) -> Array:
    """(N, d, d) ``J_q diag(scatter²) J_qᵀ + s² I`` [m²] of errors that are drawn anew in each row.

    Args:
        scatter: (n,) standard deviations of the joints from repeat to repeat [rad, m].
    """
    S = joint_columns(residuals, x) * scatter
    own = S @ np.swapaxes(S, -1, -2) + max(instrument, _MIN_SIGMA_M) ** 2 * np.eye(S.shape[1])
    return _about_points(residuals.data, own)


def _full_rank_root(covariance: Array) -> Array:
    """``R`` (k, r) with ``R Rᵀ`` the covariance, of rank r."""
    scale, values, vectors = _principal_axes(covariance)
    kept = values > 1e-12
    return np.asarray(scale[:, None] * vectors[:, kept] * np.sqrt(values[kept]))


def symmetric_root(covariance: Array) -> Array:
    """The ``R`` (k, k), ``R Rᵀ`` the covariance, that hardly changes with it: symmetric in correlations."""
    scale, values, vectors = _principal_axes(covariance)
    return np.asarray(scale[:, None] * ((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T))


def _principal_axes(covariance: Array) -> tuple[Array, Array, Array]:
    """Standard deviations (k,), and the eigenvalues (k,) and vectors (k, k) of the correlations."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    return scale, values, vectors


def _free_columns(residuals: Residuals, x: Array) -> Array:
    """Columns (N, block, f) of free frames and touched points in the Jacobian at x (k,)."""
    N, free = len(residuals.data), residuals.free
    return np.asarray(
        residuals.residuals_and_jacobian(x)[1][: N * residuals.block, free].reshape(N, residuals.block, len(free))
    )


def _pseudo_inverse(F: Array) -> Array:
    """Of the columns (m, b, p) stacked, each scaled to length one: what the data do not determine, they do not move."""
    flat = F.reshape(F.shape[0] * F.shape[1], F.shape[2])
    length = np.linalg.norm(flat, axis=0)
    scale = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0)
    return np.asarray(scale[:, None] * np.linalg.pinv(flat * scale, rcond=1e-6))


def _about_points(data: Measurements, scatter: Array) -> Array:
    """Scatter about the mean of n touches of a point is less than about the point: by 1/n of it."""
    if not data.touches:
        return scatter
    share = 1.0 / np.bincount(data.point)[data.point]
    own = np.maximum(1 - 2 * share, 0.0)  # a point touched once has no error at all; it keeps its region
    return np.asarray(scatter * own[:, None, None] + share[:, None, None] * data.point_means(scatter))
