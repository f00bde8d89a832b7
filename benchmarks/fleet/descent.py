"""Batched descent on the postures that meet a target: sequential quadratic programming, every iterate feasible.

A step solves the quadratic model of the Lagrangian with bounds held active one after the other, is brought back onto
the equations, and counts only if the objective falls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array

Residual = Callable[[Array], tuple[Array, Array]]
Objective = Callable[[Array], tuple[Array, Array]]

_RESTORED = 1e-9
_LONGEST = 0.4  # rad or m: longer steps leave the basin for no reason
_DIFFERENCE = 1e-6  # rad or m, of the Hessian
_CLOSE = 0.01  # rad or m, to a bound
_REGULAR = 1e-10  # of the multipliers: equations that depend on each other


@dataclass(frozen=True)
class Descent:
    """``minimise f(x)`` subject to ``c(x) = 0`` and bounds, from many feasible points at once."""

    objective: Objective
    residual: Residual
    lower: Array
    upper: Array

    def restored(self, X: Array) -> tuple[Array, Array]:
        """Points (N, n) brought back onto the equations by least steps, and whether they arrived (N,)."""
        X, error = X.copy(), np.full(len(X), np.inf)
        for _ in range(8):
            c, J = self.residual(X)
            error = np.abs(c).max(axis=1)
            if np.all((error < _RESTORED / 10) | (error > 1.0)):
                break
            step = _least(J, c)
            outward = ((self.lower >= X) & (step < 0)) | ((self.upper <= X) & (step > 0))
            step = np.where(outward, 0.0, _least(J * ~outward[:, None, :], c))
            X = np.clip(X + step, self.lower, self.upper)
        return X, error < _RESTORED

    def run(self, X: Array, iterations: int) -> tuple[Array, Array]:
        """Local optima (N, n) reached from the points, and their objective (N,); a point that is off is infinite."""
        X, on = self.restored(X)
        f, g = self.objective(X)
        f = np.where(on, f, np.inf)
        alive, stalls = np.flatnonzero(on), np.zeros(len(X), dtype=int)
        for _ in range(iterations):
            if not len(alive):
                break
            c, J = self.residual(X[alive])
            multipliers = -np.linalg.solve(_square(J), J @ g[alive][..., None])[..., 0]
            B = self._curvature(X[alive], g[alive], J, multipliers)
            # The second pass has the multipliers of the first one's active bounds.
            for _ in range(2):
                step, multipliers = self._step(X[alive], g[alive], B, c, J)
                B = self._curvature(X[alive], g[alive], J, multipliers)
            moved, value, slope = self._searched(X[alive], f[alive], step)
            fell = value < f[alive]
            stalls[alive] = np.where(value < f[alive] - 1e-9, 0, stalls[alive] + 1)
            rows = alive[fell]
            X[rows], f[rows], g[rows] = moved[fell], value[fell], slope[fell]
            alive = alive[stalls[alive] < 2]
        return X, f

    def _curvature(self, X: Array, g: Array, J: Array, multipliers: Array) -> Array:
        """(N, n, n) Hessian of the Lagrangian by differences, made positive: the absolute values of its eigenvalues.

        What is added along J first does not change the tangent space, and keeps its negative curvature from mattering.
        """
        N, n = X.shape
        around = (X[:, None, :] + _DIFFERENCE * np.eye(n)).reshape(N * n, n)
        slopes = self.objective(around)[1] + np.einsum(
            "nij,ni->nj", self.residual(around)[1], np.repeat(multipliers, n, axis=0)
        )
        here = g + np.einsum("nij,ni->nj", J, multipliers)
        H = (slopes.reshape(N, n, n) - here[:, None, :]) / _DIFFERENCE
        H = (H + H.transpose(0, 2, 1)) / 2
        size = np.abs(H).max(axis=(1, 2))[:, None, None]
        values, vectors = np.linalg.eigh(H + 10 * size * (J.transpose(0, 2, 1) @ J))
        least = 1e-6 * size[:, :, 0] + 1e-9
        return np.asarray((vectors * np.maximum(np.abs(values), least)[:, None, :]) @ vectors.transpose(0, 2, 1))

    def _step(self, X: Array, g: Array, B: Array, c: Array, J: Array) -> tuple[Array, Array]:
        """The step of the quadratic model, and the multipliers of the equations.

        A variable close to a bound that the step would push beyond it goes to the bound and is held there, so that the
        step of the others is a descent.
        """
        N, m, n = J.shape
        right = np.concatenate([-g, -c], axis=1)
        held, to = np.zeros((N, n), dtype=bool), np.zeros((N, n))
        solution = np.zeros((N, n + m))
        for _ in range(n):
            K = np.zeros((N, n + m, n + m))
            K[:, :n, :n], K[:, :n, n:], K[:, n:, :n] = B, J.transpose(0, 2, 1), J
            K[:, n:, n:] = -_REGULAR * np.eye(m)
            rows, columns = np.nonzero(held)
            K[rows, columns] = 0.0
            K[rows, columns, columns] = 1.0
            values = right.copy()
            values[:, :n][held] = to[held]
            solution = np.linalg.solve(K, values[..., None])[..., 0]
            step = solution[:, :n]
            low = (self.lower + _CLOSE >= X) & (X + step < self.lower) & ~held
            high = (self.upper - _CLOSE <= X) & (X + step > self.upper) & ~held
            if not np.any(low | high):
                break
            to = np.where(low, self.lower - X, np.where(high, self.upper - X, to))
            held |= low | high
        return np.where(held, to, solution[:, :n]), solution[:, n:]

    def _searched(self, X: Array, f: Array, step: Array) -> tuple[Array, Array, Array]:
        """The first of ever shorter steps that lowers the objective, with value and slope there."""
        longest = np.abs(step).max(axis=1)
        length = np.minimum(1.0, _LONGEST / np.maximum(longest, 1e-12))
        moved, value, slope = X.copy(), np.full(len(X), np.inf), np.zeros_like(X)
        open_ = np.arange(len(X))
        for _ in range(7):
            trial, on = self.restored(X[open_] + length[open_, None] * step[open_])
            reached, steepness = self.objective(trial)
            reached = np.where(on & np.isfinite(reached), reached, np.inf)
            fell = reached < f[open_] - 1e-13
            done = open_[fell]
            moved[done], value[done], slope[done] = trial[fell], reached[fell], steepness[fell]
            open_ = open_[~fell]
            if not len(open_):
                break
            length[open_] /= 4
        return moved, value, slope


def _square(J: Array) -> Array:
    """J Jᵀ (N, m, m), regular."""
    return J @ J.transpose(0, 2, 1) + 1e-12 * np.eye(J.shape[1])


def _least(J: Array, c: Array) -> Array:
    """The least steps (N, n) with J step = −c."""
    return -np.einsum("nij,ni->nj", J, np.linalg.solve(_square(J), c[..., None])[..., 0])
