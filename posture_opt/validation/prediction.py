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
from posture_opt.uncertainty.repeatability import joint_sigmas
from posture_opt.uncertainty.sources import Sources


@dataclass(frozen=True)
class JointScatter:
    """Standard deviations of the joints' errors from posture to posture, and the part that is scatter."""

    # JOINT.theta or JOINT.d -> standard deviation [rad or m], above 0
    sigma: Mapping[str, float] = field(default_factory=dict)
    instrument: float = 0.0  # standard deviation of a measured coordinate [m] that was taken off before
    measured: bool = False  # whether the data say so; else it is what the problem file states
    note: str = ""  # a sentence on where it comes from
    # the part of it that effects of the problem, or effects that were named, say
    of_effects: Mapping[str, float] = field(default_factory=dict)
    # the part of it that is the same at every repeat of a posture: the model errs there
    staying: Mapping[str, float] = field(default_factory=dict)

    @property
    def without_effects(self) -> dict[str, float]:
        """The scatter from repeat to repeat without the part of the effects, where something is left."""
        left = {}
        for name, s in self.sigma.items():
            variance = s**2 - self.of_effects.get(name, 0.0) ** 2 - self.staying.get(name, 0.0) ** 2
            if variance > 1e-6 * s**2:  # less is rounding
                left[name] = math.sqrt(variance)
        return left

    @property
    def errors(self) -> Sources:
        """What stays, as unknown errors of the joints."""
        return Sources.independent(self.staying)


def stated_scatter(problem: ProblemData) -> JointScatter:
    """What the problem states of the joints' scatter, without that of its effects."""
    sources, own = problem.sources, scatter_of_effects(problem.robot, problem.effects)
    open_words = "the data do not determine it"

    def known(covariance: Array) -> dict[str, float]:
        sigmas = zip(sources.names, np.sqrt(np.diag(covariance)).tolist(), strict=True)
        return {name: s for name, s in sigmas if s > 0}

    if scatter := known(sources.scatter):
        left = JointScatter(scatter, of_effects=own).without_effects
        return JointScatter(left, note=f"scatter of the joints as stated: {open_words}")
    joints = joint_errors(problem.robot)
    if sigma := {name: s for name, s in known(sources.constant).items() if name in joints}:
        return JointScatter(sigma, note=f"the σ's of the joints, as stated, taken for their scatter: {open_words}")
    sheet = problem.robot.repeatability
    if sheet is None:
        return JointScatter(note="the data show no scatter of the joints, and none is stated")
    found = joint_sigmas(problem.robot, sheet.value)
    sigma = dict(zip(found.names, map(float, found.sigma), strict=True))
    return JointScatter(sigma, note=f"scatter of the joints from the data sheet: {open_words}")


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
    """The σ of a joint from repeat to repeat [rad or m]: what the problem states, with the part of effects replaced."""
    variance = dict(zip(problem.sources.names, np.diag(problem.sources.scatter), strict=True)).get(name, 0.0)
    return math.sqrt(max(float(variance) - own**2, 0.0) + said**2)


def joint_errors(robot: Robot) -> tuple[str, ...]:
    """(n,) the names of the joint values' errors, JOINT.theta or JOINT.d; none of a flange without an arm."""
    return tuple(name for i in robot.driven if (name := robot.factors[i].parameter))


def prismatic_joints(residuals: Residuals) -> Mask:
    """(n,) which joints are prismatic."""
    return np.array([joint.type == "prismatic" for joint in residuals.robot.joints])


@dataclass(frozen=True, eq=False)
class ErrorSources:
    """Errors that stay and errors drawn anew at every repeat, by the parameters of the arm that err."""

    names: tuple[str, ...]  # (k,) of the parameters of the arm
    constant: Array  # (k, k) covariance of what stays from repeat to repeat [rad², m²]
    scatter: Array  # (k, k) covariance of what does not

    @classmethod
    def of(cls, residuals: Residuals, sources: Sources) -> ErrorSources:
        """The sources of a problem that have a variance."""
        known = residuals.robot.parameters
        kept = [i for i, name in enumerate(sources.names) if sources.covariance[i, i] > 0 and name in known]
        chosen = np.ix_(kept, kept)
        return cls(tuple(sources.names[i] for i in kept), sources.constant[chosen], sources.scatter[chosen])


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted errors of N rows: ``e_i = A_i δ + v_i``, δ common to all rows and v_i of each repeat its own."""

    common: Array  # (N, d, k) A, each column for a δ of variance one [m]
    scatter: Array  # (N, d, d) covariance of v [m²]

    @property
    def covariance(self) -> Array:
        """(N, d, d) [m²]."""
        return np.asarray(self.common @ np.swapaxes(self.common, -1, -2) + self.scatter)

    def take(self, rows: Codes) -> Prediction:
        """The prediction of some rows."""
        return Prediction(self.common[rows], self.scatter[rows])


def joint_columns(residuals: Residuals, x: Array) -> Array:
    """(N, d, n) shift of the measured coordinates by a unit of each joint's error [m/rad, m/m].

    x (k,) deviations from nominal [rad, m].
    """
    d = len(residuals.axes)
    named = [i for i in residuals.robot.driven if residuals.robot.factors[i].parameter]
    return residuals.metres(residuals.sensitivities(named, x)[:, :d])


def nominal_prediction(
    residuals: Residuals, x: Array, errors: ErrorSources, instrument: float, folds: Sequence[Codes], kept: Mask
) -> Prediction:
    """The errors that the model predicts before calibration for rows that its free frames were not fitted to.

    With the errors δ that stay, v_i of a repeat and F the columns of what is free (frames, touched points), fitting
    takes ``F (F_t⁺ (B_t δ + v_t))`` off, t the rows of the other folds, so that

    ``e_i = (B_i − F_i F_t⁺ B_t) δ + v_i − F_i F_t⁺ v_t``.

    x (k,) deviations with the free frames fitted; instrument: σ of a coordinate [m]; errors: sources of the problem;
    folds: rows of each fold; kept: (N,) rows that are no outliers.
    """
    N, d, block, free = len(residuals.data), len(residuals.axes), residuals.block, residuals.free
    B = residuals.sensitivities(errors.names, x)
    F = residuals.residuals_and_jacobian(x)[1][: residuals.measured, free].reshape(N, block, len(free))
    V = B @ errors.scatter @ np.swapaxes(B, -1, -2)
    V[:, range(block), range(block)] += np.where(np.arange(block) < d, (instrument / residuals.sigma) ** 2, 1.0)
    scale, values, vectors = _principal_axes(errors.constant)
    root = scale[:, None] * vectors[:, values > 1e-12] * np.sqrt(values[values > 1e-12])
    common, scatter = np.zeros((N, d, root.shape[1])), np.zeros((N, d, d))
    for left_out in folds:
        train = kept.copy()
        train[left_out] = False
        # The pseudo-inverse of columns of length one: what the data do not determine, they do not move.
        rows = int(train.sum())
        flat = F[train].reshape(rows * block, len(free))
        length = np.linalg.norm(flat, axis=0)
        unit = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0)
        G = (unit[:, None] * np.linalg.pinv(flat * unit, rcond=1e-6)).reshape(len(free), rows, block)
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

    covariance (k, k) of the parameters, from all rows; from the share ``taught`` of them it is larger; scatter (n,)
    standard deviations of the joints from repeat to repeat [rad, m].
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

    scatter (n,) standard deviations of the joints from repeat to repeat [rad, m].
    """
    S = joint_columns(residuals, x) * scatter
    # 1e-8 m: no instrument is better, and a region without thickness holds nothing
    own = S @ np.swapaxes(S, -1, -2) + max(instrument, 1e-8) ** 2 * np.eye(S.shape[1])
    return _about_points(residuals.data, own)


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


def _about_points(data: Measurements, scatter: Array) -> Array:
    if not data.touches:
        return scatter
    share = 1.0 / np.bincount(data.point)[data.point]
    own = np.maximum(1 - 2 * share, 0.0)  # a point touched once has no error at all; it keeps its region
    return np.asarray(scatter * own[:, None, None] + share[:, None, None] * data.point_means(scatter))
