"""Inverse kinematics of the brute force: batched Levenberg-Marquardt in NumPy, joints held at their limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.fleet.model import Model
from posture_opt.numerics import Array
from posture_opt.robot.robot import Robot

Limits = tuple[Array, Array]
Rows = NDArray[np.intp]
Residual = Callable[[Rows, Array], tuple[Array, Array]]

ARRIVED = 1e-8
_STEPS = 80
_PATIENCE = 10  # steps in which the error has to fall by a tenth
_LONGEST = 0.5  # rad or m


def drawn(robot: Robot, lower: Array, upper: Array, count: int, rng: np.random.Generator) -> Array:
    """(count, n) random postures between limits, of turning joints within one turn."""
    turns = np.array([joint.type == "revolute" for joint in robot.joints])
    low, high = np.where(turns, np.maximum(lower, -np.pi), lower), np.where(turns, np.minimum(upper, np.pi), upper)
    whole = low >= high
    return rng.uniform(np.where(whole, lower, low), np.where(whole, upper, high), (count, robot.n))


def led(model: Model, Q: Array, limits: Limits, points: Array, axes: Array, weights: Array) -> tuple[Array, Array]:
    """Postures (N, n) led to tool points and axes, (N, 3) or (1, 3) each, and which of them arrived (N,).

    ``weights`` (2,) of position [1/m] and axis; zero leaves one out. What has not arrived stands where it stopped.
    """
    targets = np.broadcast_to(np.hstack([points, axes]), (len(Q), 6))
    scale = np.repeat(weights, 3)

    def residual(rows: Rows, Q: Array) -> tuple[Array, Array]:
        y, J = model.pose(Q)
        return (y - targets[rows]) * scale, J * scale[:, None]

    return solved(residual, Q, limits)


def solved(residual: Residual, X: Array, limits: Limits) -> tuple[Array, Array]:
    """Points (N, n) within bounds led to a residual of zero, and which of them arrived (N,).

    ``residual`` takes the numbers of the rows that are left (k,) and their points (k, n).
    """
    X, alive = X.copy(), np.arange(len(X))
    errors, before = np.full(len(X), np.inf), np.full(len(X), np.inf)
    for turn in range(_STEPS):
        c, J = residual(alive, X[alive])
        errors[alive] = np.linalg.norm(c, axis=1)
        going = errors[alive] > ARRIVED / 10
        if turn % _PATIENCE == _PATIENCE - 1:
            going &= errors[alive] < 0.9 * before[alive]
            before = errors.copy()
        alive, c, J = alive[going], c[going], J[going]
        if not len(alive):
            break
        X[alive] = np.clip(X[alive] + held_step(X[alive], c, J, limits), *limits)
    return X, errors < ARRIVED


def held_step(Q: Array, residual: Array, J: Array, limits: Limits) -> Array:
    """Damped least squares steps (N, n); a joint at a limit that the step would push outward does not take part."""
    lower, upper = limits
    damping = 0.1 * (residual**2).sum(axis=1) + 1e-12
    held = np.zeros(Q.shape, dtype=bool)
    step = np.zeros_like(Q)
    for _ in range(Q.shape[1]):
        free = J * ~held[:, None, :]
        A = np.einsum("nij,nik->njk", free, free) + damping[:, None, None] * np.eye(Q.shape[1])
        step = -np.linalg.solve(A, np.einsum("nij,ni->nj", free, residual)[..., None])[..., 0]
        longest = np.abs(step).max(axis=1, keepdims=True)
        step *= _LONGEST / np.maximum(longest, _LONGEST)
        outward = ((lower >= Q) & (step < 0)) | ((upper <= Q) & (step > 0))
        if not np.any(outward & ~held):
            break
        held |= outward
    return np.where(held, 0.0, step)
