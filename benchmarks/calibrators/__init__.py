"""The ways to calibrate an arm, one module each, and the task that they share.

A module offers `TITLE`, `PACKAGES` and ``fit(task, learned, asked)``: it learns from some rows of the task and predicts
others. Every way runs in a process of its own, if need be by an interpreter of its own: the peers' versions of NumPy
exclude each other. So nothing here but `ours` imports posture_opt.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]

WAYS = (
    "ours_calibrated",
    "ours_extended",
    "pinocchio_fit",
    "pybotics_components",
    "pybotics_fit",
    "figaroh_fit",
    "robotkinecal_fit",
)


@dataclass(frozen=True)
class Task:
    """Measured positions of an arm whose base and tool are unknown.

    Args:
        table: (n, 4) a [m], alpha [rad], d [m], theta [rad] of the data sheet, distal convention.
        q: (N, n) [rad]; points: (N, 3) [m].
        problem, data: the files, and ``rows`` (N,) those of them that the task has; for `ours`.
    """

    table: Array
    q: Array
    points: Array
    rows: Array
    problem: str
    data: str

    def save(self, path: Path) -> None:
        np.savez(path, **self.__dict__)

    @classmethod
    def load(cls, path: Path) -> Task:
        with np.load(path) as read:
            arrays = {name: read[name] for name in ("table", "q", "points", "rows")}
            return cls(**arrays, problem=str(read["problem"]), data=str(read["data"]))

    def flange(self, rows: Array) -> Array:
        """(m, 4, 4) flange in the base frame, by the data sheet."""
        T = np.tile(np.eye(4), (len(rows), 1, 1))
        for (a, alpha, d, theta), angle in zip(self.table, self.q[rows].T, strict=True):
            T = T @ turn(2, angle + theta) @ shift(0.0, 0.0, d) @ shift(a, 0.0, 0.0) @ turn(0, np.array([alpha]))
        return T

    def frames(self, rows: Array, rounds: int = 50) -> tuple[Array, Array]:
        """Base (4, 4) in the frame of the instrument and tool point (3,), nothing else adjusted.

        The rotation by Kabsch (1976), both translations by linear least squares, in turn: a start for those that
        have none of their own.
        """
        T, measured, tool = self.flange(rows), self.points[rows], np.zeros(3)
        for _ in range(rounds):
            p = T[:, :3, :3] @ tool + T[:, :3, 3]
            U, _, Vt = np.linalg.svd((p - p.mean(0)).T @ (measured - measured.mean(0)))
            R = Vt.T @ np.diag([1.0, 1.0, np.linalg.det(Vt.T @ U.T)]) @ U.T
            A = np.concatenate([R @ T[:, :3, :3], np.tile(np.eye(3), (len(rows), 1, 1))], axis=2).reshape(-1, 6)
            tool, offset = np.split(np.linalg.lstsq(A, (measured - T[:, :3, 3] @ R.T).ravel(), rcond=None)[0], 2)
        base = np.eye(4)
        base[:3, :3], base[:3, 3] = R, offset
        return base, tool


@dataclass(frozen=True)
class Answer:
    """What a way makes of the rows that it learned from.

    Args:
        errors: (m, 3) model minus measured [m] of the rows asked for.
        stated: RMS of the position error [m] that it states of itself; None if it states none.
        sizes: parameter -> (value, standard error), of those that it gives a standard error for.
        parameters: how many it fits, where it says so.
    """

    errors: Array
    stated: float | None = None
    sizes: dict[str, tuple[float, float]] = field(default_factory=dict)
    parameters: int | None = None


def turn(axis: int, angles: Array) -> Array:
    """(m, 4, 4) about x, y or z."""
    T = np.tile(np.eye(4), (len(angles), 1, 1))
    i, j = [k for k in range(3) if k != axis]
    c, s = np.cos(angles), np.sin(angles) * (-1 if axis == 1 else 1)
    T[:, i, i], T[:, j, j], T[:, i, j], T[:, j, i] = c, c, -s, s
    return T


def shift(x: float, y: float, z: float) -> Array:
    """(4, 4)."""
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T
