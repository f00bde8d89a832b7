"""The brute force: thousands of random postures led to the target, hundreds of them descended, again and again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.fleet.criterion import exact, smooth
from benchmarks.fleet.descent import Descent
from benchmarks.fleet.inverse import drawn, solved
from benchmarks.fleet.requirements import Requirements
from posture_opt.numerics import Array

_RANDOM = 1200  # postures led to the target in one round
_MOST = 6  # rounds at most; two that agree are enough
_AGREE = 5e-4  # of the standard deviation (or of the probability)
_STAGES = ((20.0, 30, 160), (150.0, 60, 40), (1000.0, 60, 16), (8000.0, 30, 8))
"""Of each descent: the power of the norm that stands for the worst axis (within 1e-4 of the variance at last), the
iterations, and how many points take part, the best ones of the stage before."""


@dataclass(frozen=True)
class Best:
    """The best posture that a search found, its value (`criterion.exact`), and how many rounds ended there."""

    value: float
    q: tuple[float, ...]
    rounds: int
    hits: int


def better(a: float, b: float, criterion: str) -> float:
    """How much larger a is than b: relative standard deviation, or relative probability to miss."""
    return float(np.exp(min(a - b, 50.0)) - 1.0) if criterion == "miss" else a / b - 1.0


def brute_force(target: Requirements, seed: int, least_rounds: int = 2) -> Best | None:
    """The best of rounds of independent starts, until two of them end at the best; None where none arrived."""
    criterion = target.case.setup.task.criterion
    found: list[tuple[float, tuple[float, ...]]] = []
    rounds = 0
    while rounds < max(_MOST, least_rounds):
        rounds += 1
        one = _round(target, np.random.default_rng([seed, rounds]))
        found += [] if one is None else [one]
        best = min(found) if found else None
        hits = sum(better(f[0], best[0], criterion) < _AGREE for f in found) if best else 0
        if rounds >= least_rounds and hits >= 2:
            break
    return Best(best[0], best[1], rounds, hits) if best else None


def _round(target: Requirements, rng: np.random.Generator) -> tuple[float, tuple[float, ...]] | None:
    X = _arrived(target, rng)
    for power, iterations, most in _STAGES:
        if not len(X):
            return None
        X, f = _descent(target, power).run(X[:most], iterations)
        order = np.argsort(f, kind="stable")
        X = X[order[np.isfinite(f[order])]]
    return _least(target, X)


def _arrived(target: Requirements, rng: np.random.Generator) -> Array:
    """Points x = (q, s) that meet the target, from random postures and slacks."""
    setup, limits = target.case.setup, target.case.setup.limits
    Q = drawn(setup.model.robot, *limits, _RANDOM, rng)
    lower, upper = target.bounds
    n = Q.shape[1]
    slacks = rng.uniform(lower[n:], upper[n:], (_RANDOM, len(lower) - n))
    X, there = solved(lambda _, X: target.residual(X), np.hstack([Q, slacks]), target.bounds)
    X = X[there]
    return X[target.facing(np.ascontiguousarray(X[:, :n]))] if len(X) else X


def _descent(target: Requirements, power: float) -> Descent:
    setup, n = target.case.setup, target.case.setup.model.robot.n

    def objective(X: Array) -> tuple[Array, Array]:
        at, P = setup.model(np.ascontiguousarray(X[:, :n])), target.part
        C, bias = P.T @ at.covariance @ P, at.bias @ P
        dC = np.einsum("ia,nijk,jb->nabk", P, at.d_covariance, P)
        db = np.einsum("ia,nik->nak", P, at.d_bias)
        f, slope = smooth(setup.task.criterion, C, bias, dC, db, target.case.clearance, power)
        return f, np.hstack([slope, np.zeros((len(X), X.shape[1] - n))])

    return Descent(objective, target.residual, *target.bounds)


def values(target: Requirements, Q: Array) -> Array:
    """(N,) the criterion, exact, at postures (N, n)."""
    at, P = target.case.setup.model(np.atleast_2d(Q)), target.part
    return exact(target.case.setup.task.criterion, P.T @ at.covariance @ P, at.bias @ P, target.case.clearance)


def _least(target: Requirements, X: Array) -> tuple[float, tuple[float, ...]] | None:
    Q = np.ascontiguousarray(X[:, : target.case.setup.model.robot.n])
    Q = Q[target.facing(Q)] if len(Q) else Q
    if not len(Q):
        return None
    found = values(target, Q)
    k = int(np.argmin(found))
    return float(found[k]), tuple(Q[k].tolist())
