"""Batched descent on the postures that meet a target: sequential quadratic programming, every iterate feasible.

A step solves the quadratic model (damped BFGS, Powell 1978) in the tangent space with bounds held active one after
the other, is brought back onto the equations, and counts only if the objective falls.
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
        n = X.shape[1]
        B = np.broadcast_to(np.eye(n), (len(X), n, n)).copy()
        alive = np.flatnonzero(on)
        stalls = np.zeros(len(X), dtype=int)
        for _ in range(iterations):
            if not len(alive):
                break
            c, J = self.residual(X[alive])
            step, multipliers = self._step(X[alive], g[alive], B[alive], c, J)
            moved, value, slope = self._searched(X[alive], f[alive], g[alive], step)
            better = value < f[alive] - 1e-13
            B[alive] = self._updated(B[alive], X[alive], moved, g[alive], slope, J, multipliers, better)
            gained = np.where(better, f[alive] - value, 0.0)
            stalls[alive] = np.where(gained > 1e-9, 0, stalls[alive] + 1)
            B[alive[~better]] = np.eye(n)
            X[alive], g[alive] = np.where(better[:, None], moved, X[alive]), np.where(better[:, None], slope, g[alive])
            f[alive] -= gained
            alive = alive[stalls[alive] < 3]
        return X, f

    def _step(self, X: Array, g: Array, B: Array, c: Array, J: Array) -> tuple[Array, Array]:
        """The step of the quadratic model within the bounds, and the multipliers of the equations."""
        N, m, n = J.shape
        K = np.zeros((N, n + m, n + m))
        right = np.concatenate([-g, -c], axis=1)
        fixed, at = np.zeros((N, n), dtype=bool), np.zeros((N, n))
        solution = np.zeros((N, n + m))
        for _ in range(n):
            K[:, :n, :n], K[:, :n, n:], K[:, n:, :n] = B, J.transpose(0, 2, 1), J
            K[:, n:, n:] = -_REGULAR * np.eye(m)
            rows, columns = np.nonzero(fixed)
            K[rows, columns] = 0.0
            K[rows, columns, columns] = 1.0
            values = right.copy()
            values[:, :n][fixed] = at[fixed]
            solution = np.linalg.solve(K, values[..., None])[..., 0]
            step = solution[:, :n]
            low, high = X + step < self.lower - 1e-12, X + step > self.upper + 1e-12
            new = (low | high) & ~fixed
            if not np.any(new):
                break
            at = np.where(new, np.where(low, self.lower - X, self.upper - X), at)
            fixed |= new
        return np.clip(X + solution[:, :n], self.lower, self.upper) - X, solution[:, n:]

    def _searched(self, X: Array, f: Array, g: Array, step: Array) -> tuple[Array, Array, Array]:
        """The first of ever shorter steps that lowers the objective, with value and slope there."""
        longest = np.abs(step).max(axis=1)
        length = np.minimum(1.0, _LONGEST / np.maximum(longest, 1e-12))
        moved, value, slope = X.copy(), np.full(len(X), np.inf), g.copy()
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

    @staticmethod
    def _updated(
        B: Array, X: Array, moved: Array, g: Array, slope: Array, J: Array, multipliers: Array, better: Array
    ) -> Array:
        """Damped BFGS of the Lagrangian; the change of the equations' slopes is left to the next iteration."""
        s = moved - X
        y = slope - g
        Bs = np.einsum("nij,nj->ni", B, s)
        sBs, sy = (s * Bs).sum(axis=1), (s * y).sum(axis=1)
        theta = np.where(sy < 0.2 * sBs, 0.8 * sBs / np.maximum(sBs - sy, 1e-300), 1.0)
        y = theta[:, None] * y + (1 - theta)[:, None] * Bs
        sy = (s * y).sum(axis=1)
        usable = better & (sBs > 1e-18) & (sy > 1e-18)
        safe_sy, safe_sbs = np.where(usable, sy, 1.0), np.where(usable, sBs, 1.0)
        change = y[:, :, None] * y[:, None, :] / safe_sy[:, None, None]
        change -= Bs[:, :, None] * Bs[:, None, :] / safe_sbs[:, None, None]
        return np.where(usable[:, None, None], B + change, B)


def _least(J: Array, c: Array) -> Array:
    """The least steps (N, n) with J step = −c."""
    A = J @ J.transpose(0, 2, 1) + 1e-12 * np.eye(J.shape[1])
    return -np.einsum("nij,ni->nj", J, np.linalg.solve(A, c[..., None])[..., 0])
