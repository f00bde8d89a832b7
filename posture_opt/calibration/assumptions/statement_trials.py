"""``StatementTrials``: the arm of a problem calibrated without some of what its file states, each choice once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np

from posture_opt.calibration.assumptions.contradictions import FRAMES
from posture_opt.calibration.assumptions.frame_coordinates import Chart
from posture_opt.calibration.assumptions.frames import arm_and_data, fit_frames
from posture_opt.calibration.assumptions.instrument import position_sigma
from posture_opt.calibration.estimation.fit import minimum_of
from posture_opt.calibration.estimation.fit_setup import full_prior, prior_tolerances
from posture_opt.calibration.estimation.parameters import prior_covariance, tool_unknown
from posture_opt.calibration.estimation.residuals import Residuals
from posture_opt.measurements.affine_fit import reach
from posture_opt.measurements.measurements import Measurements
from posture_opt.model.effects import Effect
from posture_opt.numerics import Array, rms_length
from posture_opt.selection.problem_data import ProblemData

_STUDENT_FREEDOM = 4.0  # of Student's t, by which a few gross errors decide nothing (Lange, Little, Taylor 1989)
_LINEAR_ERROR_SHARE = 0.01  # of the reach: what a tangent leaves beyond that, only a fit of its own can judge
_DETERMINED_STRENGTH = 2.0  # σ of the data that a tolerance moves: more than a prior does
_LEAST_OF_UNSTATED = 0.01  # of the σ taken where none is stated: 1 µm, as of the best trackers

_P = TypeVar("_P", bound=ProblemData)


def released_problem(problem: _P, names: Sequence[str]) -> _P:
    """The problem without some statements."""
    return (
        problem.released([n for n in names if n in FRAMES], [n for n in names if n not in FRAMES]) if names else problem
    )


@dataclass(frozen=True, eq=False)
class StatementTrial:
    """The arm calibrated with some statements ``released``, at the estimate x (k,).

    The trials of all combinations of statements share one scale, so that their likelihoods can be compared.

    Args:
        e: (N, block) residuals; ``known`` (p, k) rows of the prior, as the data weigh it.
        count: how many combinations of parameters the data determine.
        least: that the instrument's σ can be, over the one that residuals are counted in.
    """

    released: tuple[str, ...]
    residuals: Residuals
    x: Array
    e: Array
    known: Array
    count: int
    least: float

    @cached_property
    def scale(self) -> float:
        """The residuals' standard deviation in units of the instrument's, at least ``least``, of most rows."""
        return scale_of(self.e, self.count, self.least)

    @property
    def rms(self) -> float:
        """RMS position error [m]."""
        e = self.residuals.metres(self.e[:, : len(self.residuals.axes)])
        return rms_length(e)

    @property
    def predicted_rms(self) -> float:
        """RMS position error [m] of rows left out, ``n / (n − p)`` times that of n residuals and p parameters.

        Source: generalized cross-validation (Golub, Heath, Wahba 1979).
        """
        return self.rms * self.e.size / max(self.e.size - self.count, 1)


def scale_of(e: Array, count: int, least: float) -> float:
    """The standard deviation of residuals e (N, block) from their median length, no less than ``least``.

    ``count`` parameters were fitted.
    """
    from scipy.special import gammaincinv

    N, block = e.shape
    squared = float(np.median(np.sum(e**2, axis=1))) / (2 * float(gammaincinv(block / 2, 0.5)))
    return max(float(np.sqrt(squared * N * block / max(N * block - count, 1))), least)


def negative_log_likelihood(e: Array, known: Array, scale: float) -> float:
    """Minus the logarithm of the likelihood of residuals (N, block) under Student's t of a ``scale``.

    And of ``known`` (p,), how far what the prior holds is from it in units of the same scale, under a Gaussian.

    ``(ν + d)/2 Σ log(1 + |e_i|² / (ν s²)) + |known|² / (2 s²)``, up to a constant; ν = `_STUDENT_FREEDOM`, d = block.
    """
    squared = np.sum(e**2, axis=1) / scale**2
    data = float(np.sum(np.log1p(squared / _STUDENT_FREEDOM)) * (_STUDENT_FREEDOM + e.shape[1]) / 2)
    return data + float(known @ known) / (2 * scale**2)


class StatementTrials(Generic[_P]):
    """The statements of one problem against one file, each combination of them fitted once.

    Attributes:
        statements: names of frames that are stated as exact, then of parameters with a stated σ.
        sigma: of the latter [rad or m].
    """

    def __init__(self, problem: _P, data: Measurements, priors: bool, effects: Sequence[Effect] = ()) -> None:
        self.problem: _P = problem
        self.data: Measurements = data
        self.priors: bool = priors
        self.effects: Sequence[Effect] = effects
        self._trials: dict[tuple[str, ...], StatementTrial] = {}
        robot = problem.robot
        free = {"base": robot.base_free or data.position is None, "tool": tool_unknown(robot, data)}
        frames = tuple(name for name in FRAMES if not free[name])
        residuals = arm_and_data(problem, data)[0]
        rows, covariance = prior_covariance(problem, residuals.parameters) if priors else ([], np.zeros((0, 0)))
        names = [residuals.parameters[i] for i in rows]
        self.sigma: dict[str, float] = {
            p.name: float(np.sqrt(covariance[k, k])) for k, p in enumerate(names) if p.group == "geometry"
        }
        self.statements: tuple[str, ...] = (*frames, *self.sigma)
        self.frames: tuple[str, ...] = frames

    def trial(self, released: Sequence[str]) -> StatementTrial:
        """The arm calibrated without some of the statements."""
        key = tuple(name for name in self.statements if name in released)
        if key not in self._trials:
            self._trials[key] = self._fitted_trial(key, self.weight)
        return self._trials[key]

    @cached_property
    def weight(self) -> float:
        """The standard deviation, in units of the instrument's, of what nothing explains: by it the prior is weighed.

        To first order about the arm as stated, unless that is too far off for tangents.
        """
        residuals, x = self._start(arm_and_data(self.problem, self.data)[0])
        e, _, count = self.without_all(residuals, x, 1.0)
        if self.far_off(e, residuals):
            return self._fitted_trial(self.statements, 1.0).scale
        return scale_of(e, count, self.least)

    @cached_property
    def least(self) -> float:
        """The least σ of the instrument, over the one taken: where none is stated, it may be much better than that."""
        return 1.0 if position_sigma(self.problem, self.data) else _LEAST_OF_UNSTATED

    def far_off(self, e: Array, residuals: Residuals) -> bool:
        """Whether residuals (N, block) are so far off that a tangent says little of them."""
        axes = len(residuals.axes)
        left = rms_length(residuals.metres(e[:, :axes]))
        return left > _LINEAR_ERROR_SHARE * reach(self.problem.robot)

    def _fitted_trial(self, released: tuple[str, ...], weight: float) -> StatementTrial:
        """The arm fitted without the ``released`` statements, in the chart that suits its frames."""
        problem = released_problem(self.problem, released)
        residuals, x = self._start(Chart.of(arm_and_data(problem, self.data)[0]).fitted)
        return self._calibrated_trial(problem, residuals, x, released, weight)

    def _calibrated_trial(
        self, problem: _P, residuals: Residuals, x0: Array, released: tuple[str, ...], weight: float
    ) -> StatementTrial:
        """The arm fitted without the ``released`` statements, from ``x0`` (k,); ``weight`` is that of the prior."""
        parameters = residuals.parameters
        stated = prior_covariance(problem, parameters)[0] if self.priors else []
        known = weight * _prior_rows(problem, residuals, stated)
        x, found = minimum_of(residuals, x0, np.diag(prior_tolerances(parameters, [])), known)
        count = int(np.sum(np.linalg.svd(found.R, compute_uv=False) > _DETERMINED_STRENGTH * weight))
        e = found.residuals[: residuals.measured].reshape(len(residuals.data), -1)
        return StatementTrial(released, residuals, x, e, known, count, self.least)

    def _start(self, residuals: Residuals) -> tuple[Residuals, Array]:
        """The unknowns with those of the effects, and where a fit of them starts (k,): free frames fitted."""
        x = fit_frames(residuals)
        if not self.effects:
            return residuals, x
        wide = residuals.with_effects(self.effects, x)
        return wide, np.r_[x, wide.start_of(self.effects)]

    def without_all(self, residuals: Residuals, x: Array, weight: float) -> tuple[Array, Array, int]:
        """Residuals (N, block), those of the prior (p,) and the rank, without any statement; to first order.

        Args:
            residuals: as stated, with deviations x (k,); weight: of the prior, in units of the instrument's σ.
        """
        wide = arm_and_data(released_problem(self.problem, self.statements), self.data)[0]
        wide = wide.with_effects(self.effects, fit_frames(wide)) if self.effects else wide
        value = dict(zip((p.name for p in residuals.parameters), x, strict=True))
        at = np.array([value.get(p.name, 0.0) for p in wide.parameters])
        r, J = wide.residuals_and_jacobian(at)
        known = weight * _prior_rows(self.problem, wide, [])
        columns = np.concatenate([J, known])
        step = np.linalg.lstsq(columns, -np.concatenate([r, known @ at]), rcond=1e-12)[0]
        strength = np.linalg.svd(J * prior_tolerances(wide.parameters, []), compute_uv=False)
        e = (r + J @ step)[: wide.measured].reshape(len(self.data), -1)
        return e, known @ (at + step), int(np.sum(strength > _DETERMINED_STRENGTH * weight))

    @cached_property
    def scale(self) -> float:
        """The scale of the likelihood: that of the widest model, or of the stated one where it is smaller."""
        return min(self.trial(self.statements).scale, self.trial(()).scale)

    def cost(self, trial: StatementTrial) -> float:
        """Minus the log-likelihood of a trial at the scale of the widest."""
        return negative_log_likelihood(trial.e, trial.known @ trial.x, self.scale)


def _prior_rows(problem: ProblemData, residuals: Residuals, stated: list[int]) -> Array:
    """Stated σ's and tolerances as further rows (p, k) of the Jacobian."""
    parameters = residuals.parameters
    covariance = prior_covariance(problem, parameters)[1] if stated else np.zeros((0, 0))
    prior = full_prior(parameters, problem.robot, prior_tolerances(parameters, stated), stated, covariance)
    return prior.matrix(len(parameters))
