"""Which parameters vary together from robot to robot, and what the problem file states of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.batch.batch_covariance import BatchCovariance
from posture_opt.calibration.parameters import CalibrationProblem, Parameter
from posture_opt.numerics import Array

_SIZE = 0.05  # of the tests of all correlations together


@dataclass(frozen=True, eq=False)
class Pair:
    """Two parameters that vary together, or may: the correlation, its 95 % interval, the stated one."""

    a: str
    b: str
    correlation: float
    interval: tuple[float, float]
    p_value: float
    stated: float
    real: bool

    def to_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return {
            "parameters": [self.a, self.b], "correlation": self.correlation, "interval95": list(self.interval),
            "p_value": self.p_value, "stated": self.stated, "significant": self.real,
        }  # fmt: skip


def pairs_of(parameters: Sequence[Parameter], spread: BatchCovariance, problem: CalibrationProblem) -> tuple[Pair, ...]:
    """Every pair, the surest first; which are real, by Holm's (1979) rule over all of them."""
    names, stated = [p.name for p in parameters], _stated_correlations(problem)
    k = len(names)
    indices = [(i, j) for i in range(k) for j in range(i + 1, k)]
    indices.sort(key=lambda ij: float(spread.p_correlation[ij]))
    found, standing = [], True
    for rank, (i, j) in enumerate(indices):
        p = float(spread.p_correlation[i, j])
        standing = standing and p <= _SIZE / (len(indices) - rank)
        low, high = map(float, spread.correlation_interval[i, j])
        said = stated.get(frozenset((names[i], names[j])), 0.0)
        rho = float(spread.correlation[i, j])
        found.append(Pair(names[i], names[j], rho, (low, high), p, said, standing))
    return tuple(found)


def stated_sigmas(parameters: Sequence[Parameter], problem: CalibrationProblem) -> Array:
    """(k,) what the problem file states of each parameter; zero where it states nothing [rad, m]."""
    sources = problem.sources
    place = {name: i for i, name in enumerate(sources.names)}
    variances = np.diag(sources.constant)
    return np.array([np.sqrt(variances[place[p.name]]) if p.name in place else 0.0 for p in parameters])


def _stated_correlations(problem: CalibrationProblem) -> dict[frozenset[str], float]:
    sources = problem.sources
    sigma = np.sqrt(np.diag(sources.constant))
    pairs = np.argwhere(np.triu(sources.constant, 1) != 0)
    return {
        frozenset((sources.names[i], sources.names[j])): float(sources.constant[i, j] / (sigma[i] * sigma[j]))
        for i, j in pairs
    }
