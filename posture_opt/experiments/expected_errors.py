"""What is known of an arm before and after measurements: standard errors, observability, the task's variance.

All errors are those of a linear model at one set of deviations: they shrink with the square root of the number of
measurements, and say nothing of what the model lacks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from posture_opt.calibration.estimation.fit_setup import full_prior, prior_tolerances
from posture_opt.calibration.estimation.identifiability import (
    Identifiability,
    identify_parameters,
    observability_indices,
)
from posture_opt.calibration.estimation.parameters import Parameter, prior_covariance
from posture_opt.calibration.estimation.prior import Prior
from posture_opt.experiments.exchange import Criterion, Determinant, Variance, quantity_variances, unit_information
from posture_opt.experiments.information import GivenInformation
from posture_opt.numerics import Array, Mask
from posture_opt.selection.problem_data import ProblemData

_RANK_TOLERANCE = 1e-7  # of the largest singular value


@dataclass(frozen=True, eq=False)
class ExpectedErrors:
    """What is expected to be known at one stage.

    Args:
        std: (k,) expected standard errors [rad, m]; NaN where a parameter is not determined.
        task: expected standard deviation of the tool point at the task's posture that what is not known of the
            parameters makes: root of the summed variances along the directions that count [m]; NaN without a task,
            and where it is not determined.
        observability: O1 … O5 of all measurements made till then, unknowns scaled to unit RMS over the candidates.
    """

    std: Array
    task: float
    observability: dict[str, float]

    @classmethod
    def median(cls, stages: Sequence[ExpectedErrors]) -> ExpectedErrors:
        """The median of each figure; what is not determined counts as infinite."""
        std = _nan_median([stage.std for stage in stages])
        task = float(_nan_median([np.array(stage.task) for stage in stages]))
        names = stages[0].observability
        return cls(std, task, {name: float(np.median([s.observability[name] for s in stages])) for name in names})


def _nan_median(values: Sequence[Array]) -> Array:
    """The median over stages, entry by entry; NaN counts as infinite, and an infinite median is NaN again."""
    middle = np.median([np.where(np.isnan(value), np.inf, value) for value in values], axis=0)
    return np.where(np.isinf(middle), np.nan, middle)


@dataclass(frozen=True, eq=False)
class PriorInformation:
    """What is known of the unknowns without any measurement.

    Args:
        scale: (k,) tolerances [rad, m].
        stated: (k,) whether a σ is stated.
        W: square root of the information of the stated σ's (p, k); ``full`` has the tolerances of the geometry too.
    """

    names: tuple[str, ...]
    scale: Array
    stated: Mask
    W: Array
    full: Array

    @classmethod
    def of(cls, problem: ProblemData, parameters: tuple[Parameter, ...], made: Array | None = None) -> PriorInformation:
        """From the σ's that a problem states and the tolerances of `prior_tolerances`.

        Args:
            made: (k,) tolerances that count in place of these; NaN where there is none.
        """
        rows, covariance = prior_covariance(problem, parameters)
        k, scale = len(parameters), prior_tolerances(parameters, rows)
        within = scale if made is None else np.where(np.isfinite(made), made, scale)
        prior = full_prior(parameters, problem.robot, within, rows, covariance).matrix(k)
        names = tuple(p.name for p in parameters)
        return cls(names, scale, np.isin(np.arange(k), rows), Prior.of(rows, covariance).matrix(k), prior)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The unknowns that candidate measurements say something of, with all that is known already.

    Deviations from nominal are ``x = D z``: directions that nothing measured can feel are projected out.

    Args:
        known: what all candidates with the given data and the stated σ's determine.
        D: (k, r) deviations [rad, m] per unit of z; ``T`` (r, r) takes unknowns of unit information to z.
        start: (r, r) information on z from the given data and the prior.
        seen: (k, s) directions that measurements alone determine, of unit RMS over the candidates.
        L: (t, r) shift of the tool point at the task's posture along the t directions that count; (0, r) without.
    """

    prior: PriorInformation
    given: GivenInformation
    known: Identifiability
    D: Array
    T: Array
    start: Array
    seen: Array
    L: Array

    @classmethod
    def of(cls, prior: PriorInformation, J: Array, given: GivenInformation, tool_rows: Array, count: int) -> Unknowns:
        """From the candidates' derivatives J (N, b, k), for a plan of ``count`` of them."""
        flat = np.sqrt(count / len(J)) * J.reshape(-1, J.shape[-1])
        measured = np.concatenate([flat, given.R]) / np.sqrt(given.variance)
        names, scale = prior.names, prior.scale
        alone = identify_parameters(names, measured, count, scale=scale)
        known = identify_parameters(names, np.concatenate([measured, prior.W]), count, scale=scale)
        D = np.concatenate([known.directions, known.hardly], axis=1)
        start = sum((R @ D).T @ (R @ D) for R in (given.R / np.sqrt(given.variance), prior.full))
        average = measured[: len(flat)] @ D
        rms = np.sqrt(np.mean(np.sum(J**2, axis=1), axis=0))
        unit = 1.0 / np.where(rms > 0, rms, 1.0)
        seen = unit[:, None] * np.linalg.qr(alone.directions / unit[:, None])[0]
        T = unit_information(start + average.T @ average)
        return cls(prior, given, known, D, T, np.asarray(start), seen, tool_rows @ D)

    @property
    def count(self) -> int:
        """The number r of combinations that are determined, or at least felt."""
        return int(self.D.shape[1])

    @property
    def settled(self) -> Mask:
        """(k,) which parameters are determined already, or would be by all candidates together."""
        return np.asarray(self.known.determined | self.already)

    @cached_property
    def already(self) -> Mask:
        """(k,) which parameters the given data and the stated σ's determine: more data take nothing back."""
        return np.asarray(self._identified(self.given.R).determined | self.prior.stated)

    def criterion(self, purpose: str) -> Criterion:
        """What a plan for ``parameters`` or for the ``task`` makes small, in the unknowns z.

        ``parameters`` and ``recheck`` are D-optimal, ``task`` L-optimal: the summed variance of the tool point along
        the directions that count.
        """
        return Variance(self.L) if purpose == "task" else Determinant()

    def blocks(self, J: Array) -> Array:
        """(N, b, r) what candidates measure of z, in standard deviations of the measurement."""
        return np.asarray(J @ self.D / np.sqrt(self.given.variance))

    def before(self, J: Array) -> ExpectedErrors:
        """What is known without the measurements J (n, b, k).

        Where nothing was measured, the stated σ's alone speak of the task: nominal values are no knowledge.
        """
        stage, W = self.after(J[:0]), self.prior.W @ self.D
        if self.given.rows:
            return stage
        return replace(stage, task=_root_sum(quantity_variances(W.T @ W, self.L, self.T)))

    def after(self, J: Array) -> ExpectedErrors:
        """What is known after the measurements J (n, b, k) on top of what is known already."""
        flat = self.blocks(J).reshape(-1, self.count)
        M = self.start + flat.T @ flat
        task = _root_sum(quantity_variances(M, self.L, self.T))
        found = self._identified(np.concatenate([J.reshape(-1, J.shape[-1]), self.given.R]))
        # Combinations that nothing determines leave each parameter its part of a tolerance.
        std = np.sqrt(quantity_variances(M, self.D, self.T) + found.unseen**2)
        std = np.where(self.already | found.determined, std, np.nan)
        return ExpectedErrors(std, task, self._observability(J))

    def _identified(self, rows: Array) -> Identifiability:
        """What whitened rows (m, k) together with the stated σ's determine."""
        stack = np.concatenate([rows / np.sqrt(self.given.variance), self.prior.W])
        return identify_parameters(self.prior.names, stack, len(stack) + 1, scale=self.prior.scale)

    def _observability(self, J: Array) -> dict[str, float]:
        """O1 … O5 of the given data with measurements J (n, b, k).

        Zeros where they do not determine all that candidates can.
        """
        s = np.linalg.svd(np.concatenate([self.given.R, J.reshape(-1, J.shape[-1])]) @ self.seen, compute_uv=False)
        if not 0 < self.seen.shape[1] <= len(s) or s[-1] <= _RANK_TOLERANCE * s[0]:
            return dict.fromkeys(("O1", "O2", "O3", "O4", "O5"), 0.0)
        return observability_indices(np.asarray(s, dtype=float), self.given.rows + len(J))


def _root_sum(along: Array) -> float:
    """Root of the summed variances along all directions; NaN where one is not determined, or there are none."""
    return float(np.sqrt(np.sum(along))) if len(along) else float("nan")
