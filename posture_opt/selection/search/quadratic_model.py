"""The quadratic model of a nonlinear program at some points, and its least value within a radius.

For ``min f(x)`` under rows ``l ≤ g(x) ≤ u`` and bounds of the variables the step p solves

``min ∇fᵀp + pᵀHp/2``  with  ``A p = b − g`` for the rows of the working set,  ``p_j = b_j − x_j`` for its bounds,

H being the Hessian of the Lagrangian: by the least step that meets the rows, and along what they leave free the least
value within a radius (Moré and Sorensen 1983, here by eigenvalues), which a Hessian that bends downwards does not
mislead. The working set changes as in a primal active set method (Nocedal and Wright 2006, section 16.5), but once in a
step instead of in a loop inside it: what a step meets first joins, what has a multiplier of the wrong sign leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Self

import numpy as np

from posture_opt.numerics import Array, Codes, Mask

# What the loops in C and in NumPy agree on: `local_search.c` takes them as macros of these names.
PENALTY = 1e3  # of a squared row in the merit, in units of the objective (about 1)
WORKING_SET_TOLERANCE = 1e-8  # rad or m: a row or bound that is violated by more belongs to the working set
JOINED_MULTIPLIER = 1e-12  # of what has just joined; half of it where it would leave at once, to be met again
LEAST_CHANGE = 1e-12  # rad, m or of a row: a smaller change is none
DEPENDENT_ROW_TOLERANCE = 1e-10  # of a row's own square: rows that repeat others, or more rows than joints
FLAT_CURVATURE = 1e-8  # of the largest curvature: below it a direction changes nothing, above its rounding
TINY_CURVATURE = 1e-12  # in place of the largest curvature where there is none
MAX_SHIFTS = 50  # Newton steps for the shift of the eigenvalues: some five are usual
RADIUS_TOLERANCE = 1e-6  # of the radius: how near a step comes to it
INFINITE_BOUND = 1e6  # instead of infinity, which makes NaN of zero
LONGEST_STEP = 0.5  # rad or m: the quadratic model of a rotation means nothing beyond
SMALLER, LARGER = 0.25, 4.0  # the next radius, after a step that made the merit worse and after one taken
MERIT_TOLERANCE = 1e-7  # of the merit: its rounding
VIOLATION_PRICE, MOST_VIOLATION = 100.0, 1e-5  # of the merit for each m or rad, and at most: last digits of rows
MAX_IDLE_STEPS = 2  # without motion, the multipliers settled: where rows cannot be met, say
SMALLEST_RADIUS = 1e-5  # rad or m: what is no better within it stays where it is
MAX_MULTIPLIER = 1e3  # in the Hessian: where rows nearly depend on each other, estimates are anything


@dataclass(frozen=True)
class QuadraticModel:
    """N models of n variables under m rows and n bounds, the rows first."""

    value: Array  # (N, m + n) rows and variables
    low: Array  # (N, m + n) finite, as ``high``
    high: Array
    y: Array  # (N, m + n) multipliers, positive at upper ends, zero outside of the working set
    slope: Array  # (N, n) of the objective
    A: Array  # (N, m, n) of the rows

    def at(self, rows: Codes | Mask) -> Self:
        """Models of some points, with their cached quantities."""
        some = type(self)(*(getattr(self, field.name)[rows] for field in fields(self)))
        some.__dict__.update(_of_rows(self.__dict__, rows))
        return some

    @property
    def m(self) -> int:
        return int(self.A.shape[1])

    @cached_property
    def equal(self) -> Mask:
        """(N, m + n) equalities."""
        return np.asarray(self.low == self.high)

    @cached_property
    def above(self) -> Mask:
        """(N, m + n) whether the upper end is in the working set; an equality counts as one."""
        return self.equal | (self.y > 0) | (self.value > self.high + WORKING_SET_TOLERANCE)

    @cached_property
    def working(self) -> Mask:
        """(N, m + n) whether either end is in the working set."""
        return self.above | (self.y < 0) | (self.value < self.low - WORKING_SET_TOLERANCE)

    @cached_property
    def gap(self) -> Array:
        """(N, m + n) how far the ends in the working set are away, zero elsewhere."""
        return np.where(self.working, np.where(self.above, self.high, self.low) - self.value, 0.0)

    @cached_property
    def _orthonormal(self) -> tuple[Array, Array]:
        """Q (N, m, n), L (N, m, m): ``A = L Q`` of the working set; a dependent row has zero pivot and row."""
        held, rows = self.working[:, None, self.m :], self.working[:, : self.m, None]
        Q = np.where(rows & ~held, self.A, 0.0)
        L = np.zeros((len(Q), self.m, self.m))
        for i in range(self.m):
            q = Q[:, i]
            before = _dot(q, q)
            for _ in range(2):
                shares = np.einsum("kij,kj->ki", Q[:, :i], q)
                L[:, i, :i] += shares
                q = q - np.einsum("ki,kij->kj", shares, Q[:, :i])
            after = _dot(q, q)
            kept = (after > DEPENDENT_ROW_TOLERANCE * before) & (before > 0)
            L[:, i, i] = np.where(kept, np.sqrt(after), 0.0)
            Q[:, i] = np.where(kept[:, None], q / np.where(kept, L[:, i, i], 1.0)[:, None], 0.0)
        return Q, L

    def multipliers(self, slope: Array) -> Array:
        """(N, m + n) multipliers that leave the least residual with a slope (N, n), zero outside of the working set."""
        Q, L = self._orthonormal
        w = np.zeros(L.shape[:2])
        for i in reversed(range(self.m)):
            rest = -_dot(Q[:, i], slope) - _dot(L[:, i + 1 :, i], w[:, i + 1 :])
            w[:, i] = _over(rest, L[:, i, i])
        held = -(slope + np.einsum("kij,ki->kj", self.A, w))
        return np.hstack([w, np.where(self.working[:, self.m :], held, 0.0)])

    def signed(self, multipliers: Array) -> Array:
        """Multipliers (N, m + n), zero where an inequality has one of the wrong sign."""
        right = np.where(self.above, np.maximum(multipliers, 0.0), np.minimum(multipliers, 0.0))
        return np.where(self.working, np.where(self.equal, multipliers, right), 0.0)

    @cached_property
    def estimate(self) -> Array:
        """(N, m + n) the multipliers here, by least squares."""
        return self.multipliers(self.slope)

    @property
    def stationarity(self) -> Array:
        """(N,) the largest residual of stationarity, or of complementarity: a multiplier times what its end is away."""
        y = self.signed(self.estimate)
        residual = self.slope + np.einsum("kij,ki->kj", self.A, y[:, : self.m]) + y[:, self.m :]
        away = np.where(self.equal, 0.0, y * self.gap)
        return np.asarray(np.max(np.abs(np.hstack([residual, away])), axis=1))

    @cached_property
    def normal(self) -> Array:
        """(N, n) the least step that meets the rows of the working set and the bounds that are held."""
        Q, L = self._orthonormal
        step, t = self.gap[:, self.m :].copy(), np.zeros(L.shape[:2])
        short = self.gap[:, : self.m] - np.einsum("kij,kj->ki", self.A, step)
        for i in range(self.m):
            t[:, i] = _over(short[:, i] - _dot(L[:, i, :i], t[:, :i]), L[:, i, i])
        return np.asarray(step + np.einsum("ki,kij->kj", t, Q))

    @cached_property
    def projector(self) -> Array:
        """(N, n, n) onto directions along the working set's rows and bounds."""
        Q, _ = self._orthonormal
        free = ~self.working[:, self.m :]
        return np.asarray(np.einsum("kj,jl->kjl", free, np.eye(free.shape[1])) - np.einsum("kij,kil->kjl", Q, Q))


@dataclass(frozen=True)
class Curved:
    """N models with their Hessians of the Lagrangian (N, n, n)."""

    model: QuadraticModel
    H: Array

    def at(self, rows: Codes | Mask) -> Self:
        """Models of some points, with their cached quantities."""
        some = type(self)(self.model.at(rows), self.H[rows])
        some.__dict__.update(_of_rows({k: v for k, v in self.__dict__.items() if k not in ("model", "H")}, rows))
        return some

    @cached_property
    def _axes(self) -> tuple[Array, Array]:
        """Curvatures (N, n) along unit vectors, columns of (N, n, n); infinite along held directions."""
        P = self.model.projector
        size = 1 + 2 * np.max(np.sum(np.abs(self.H), axis=2), axis=1)[:, None, None]
        values, axes = np.linalg.eigh(P @ self.H @ P + size * (np.eye(P.shape[1]) - P))
        taken = np.einsum("kji,kjl,kli->ki", axes, P, axes) < 0.5
        return np.where(taken, np.inf, values), axes

    @cached_property
    def _floor(self) -> Array:
        """(N,) the curvature below which a direction counts as flat."""
        values, _ = self._axes
        finite = np.where(np.isinf(values), 0.0, values)
        return np.asarray(FLAT_CURVATURE * np.max(np.abs(finite), axis=1, initial=TINY_CURVATURE))

    @cached_property
    def indefinite(self) -> Mask:
        """(N,) negative curvature along a free direction."""
        return np.asarray(np.min(self._axes[0], axis=1) < -self._floor)

    def step(self, radius: Array) -> Array:
        """(N, n) the least value of each model within its radius (N,); the step onto the rows is shortened to it."""
        (values, axes), normal = self._axes, self.model.normal
        longest = np.max(np.abs(normal), axis=1)
        share = np.where(longest > radius, radius / np.maximum(longest, TINY_CURVATURE), 1.0)[:, None]
        slope = self.model.slope + share * np.einsum("kij,kj->ki", self.H, normal)
        c = np.where(np.isinf(values), 0.0, np.einsum("kji,kj->ki", axes, slope))
        shift = np.maximum(self._floor - np.min(values, axis=1), 0.0)
        for _ in range(MAX_SHIFTS):
            lifted = values + shift[:, None]
            squares = (c / lifted) ** 2
            size = np.sqrt(np.sum(squares, axis=1))
            beyond = size > radius * (1 + RADIUS_TOLERANCE)
            if not np.any(beyond):
                break
            fall = np.where(beyond, np.sum(squares / lifted, axis=1), 1.0)
            shift = shift + np.where(beyond, (size / radius - 1) * size * size / fall, 0.0)
        return np.asarray(share * normal - np.einsum("kji,ki->kj", axes, c / (values + shift[:, None])))

    def gain(self) -> Array:
        """(N,) decrease of the quadratic model by Newton's step, ``−(∇f + Aᵀλ)·p − pᵀHp/2``; infinite without one."""
        model, p = self.model, self.step(np.full(len(self.H), np.inf))
        w = model.estimate[:, : model.m]
        slope = model.slope + np.einsum("kij,ki->kj", model.A, w)
        found = -_dot(slope, p) - np.einsum("ki,kij,kj->k", p, self.H, p) / 2
        return np.where(self.indefinite, INFINITE_BOUND, found)

    def advanced(self, radius: Array) -> tuple[Array, Array]:
        """Step (N, n) within a radius (N,) up to what it meets first, and the next multipliers (N, m + n)."""
        model, p = self.model, self.step(radius)
        y = model.signed(model.multipliers(model.slope + np.einsum("kij,kj->ki", self.H, p)))
        y = np.where((y == 0) & (np.abs(model.y) == JOINED_MULTIPLIER), np.sign(model.y) * JOINED_MULTIPLIER / 2, y)
        change = np.hstack([np.einsum("kij,kj->ki", model.A, p), p])
        meets = ~model.working & (np.abs(change) > LEAST_CHANGE)
        room = np.where(change > 0, model.high, model.low) - model.value
        ratio = np.where(meets, np.maximum(room / np.where(meets, change, 1.0), 0.0), np.inf)
        first = np.min(ratio, axis=1, initial=1.0)
        joined = np.where(ratio <= first[:, None], np.sign(change) * JOINED_MULTIPLIER, 0.0)
        return first[:, None] * p, np.where(model.working, y, joined)


def merit(objective: Array, g: Array, low: Array, high: Array, y: Array) -> Array:
    """(N,) the augmented Lagrangian of rows g (N, m) (Rockafellar 1973); steps keep the bounds."""
    equal = low == high
    beyond = g - high
    upper, lower = np.maximum(y, 0.0), np.maximum(-y, 0.0)
    over, under = np.maximum(beyond, -upper / PENALTY), np.maximum(low - g, -lower / PENALTY)
    one = upper * over + PENALTY / 2 * over**2 + lower * under + PENALTY / 2 * under**2
    return np.asarray(objective + np.sum(np.where(equal, y * beyond + PENALTY / 2 * beyond**2, one), axis=1))


def _of_rows(
    known: Mapping[str, Array | tuple[Array, ...]], rows: Codes | Mask
) -> dict[str, Array | tuple[Array, ...]]:
    return {k: tuple(a[rows] for a in v) if isinstance(v, tuple) else v[rows] for k, v in known.items()}


def _dot(a: Array, b: Array) -> Array:
    """(N,) scalar products of rows (N, k)."""
    return np.asarray(np.einsum("ki,ki->k", a, b))


def _over(a: Array, b: Array) -> Array:
    """(N,) quotients, zero where the divisor is."""
    return np.where(b > 0, a / np.where(b > 0, b, 1.0), 0.0)
