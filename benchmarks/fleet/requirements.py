"""What a target asks of a posture, as equations in the joints and slacks, and the part of the spread that counts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.fleet.cases import Case
from benchmarks.fleet.inverse import drawn
from posture_opt.numerics import Array

_SAMPLES = 40
_NOTHING = 1e-9  # of a singular value: what never moves


@dataclass(frozen=True)
class Requirements:
    """The equations of one case in x = (q, s): the slacks s turn a region and a tilt into equations with bounds."""

    case: Case

    @cached_property
    def _samples(self) -> tuple[Array, Array, Array]:
        model = self.case.setup.model
        Q = drawn(model.robot, *self.case.setup.limits, _SAMPLES, np.random.default_rng(0))
        at = model(Q)
        return at.position, at.axis, at.covariance

    @cached_property
    def moving(self) -> Array:
        """The coordinates of the tool point that the arm changes."""
        return np.flatnonzero(np.ptp(self._samples[0], axis=0) > 1e-9)

    @cached_property
    def sideways(self) -> Array:
        """(3, k) directions across the target's that the tool axis has to have no component in."""
        d = np.array(self.case.direction)
        across = np.linalg.svd(d[None])[2][1:].T
        axes = self._samples[1]
        if not self.case.setup.aligned or np.ptp(axes, axis=0).max() < _NOTHING:
            return np.zeros((3, 0))
        _, sizes, turns = np.linalg.svd(axes)
        if sizes[-1] > _NOTHING * sizes[0]:
            return across
        in_plane = np.cross(turns[-1], d)[:, None]
        return np.asarray(in_plane / np.linalg.norm(in_plane))

    @cached_property
    def part(self) -> Array:
        """(3, m) basis of the part of the spread that counts, without directions in which nothing ever spreads."""
        d = np.array(self.case.direction)
        within = self.case.setup.task.within
        basis = {"along": d[:, None], "across": np.linalg.svd(d[None])[2][1:].T, "all": np.eye(3)}[within]
        sizes, vectors = np.linalg.eigh(basis.T @ self._samples[2].sum(axis=0) @ basis)
        return np.asarray(basis @ vectors[:, sizes > _NOTHING**2 * sizes[-1]])

    @property
    def box(self) -> bool:
        return any(self.case.setup.task.half_box)

    @property
    def tilted(self) -> bool:
        return self.case.setup.task.tilt > 0 and self.sideways.shape[1] > 0

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Bounds of x: joints, then the moving coordinates of a region, then the squared sine of the tilt."""
        lower, upper = (list(side) for side in self.case.setup.limits)
        if self.box:
            low, high = self.case.box
            lower, upper = lower + low[self.moving].tolist(), upper + high[self.moving].tolist()
        if self.tilted:
            lower, upper = [*lower, 0.0], [*upper, float(np.sin(self.case.setup.task.tilt) ** 2)]
        return np.array(lower), np.array(upper)

    def residual(self, X: Array) -> tuple[Array, Array]:
        """Residuals (N, m) and Jacobian (N, m, n + k) of the equations."""
        n = self.case.setup.model.robot.n
        y, J = self.case.setup.model.pose(np.ascontiguousarray(X[:, :n]))
        point, S, k = y[:, self.moving], self.sideways, len(self.moving)
        rows = [point - (X[:, n : n + k] if self.box else np.array(self.case.position)[self.moving])]
        lean, d_lean = y[:, 3:] @ S, np.einsum("ik,nij->nkj", S, J[:, 3:])
        slopes = [J[:, self.moving]]
        if self.tilted:
            rows.append((lean**2).sum(axis=1, keepdims=True) - X[:, -1:])
            slopes.append(2 * np.einsum("nk,nkj->nj", lean, d_lean)[:, None])
        else:
            rows.append(lean)
            slopes.append(d_lean)
        slope = np.concatenate(slopes, axis=1)
        full = np.zeros((*slope.shape[:2], X.shape[1]))
        full[:, :, :n] = slope
        if self.box:
            full[:, :k, n : n + k] = -np.eye(k)
        if self.tilted:
            full[:, -1, -1] = -1.0
        return np.hstack(rows), full

    def facing(self, Q: Array) -> Array:
        """(N,) whether the tool axis does not point the wrong way."""
        if not self.sideways.shape[1]:
            return np.ones(len(Q), dtype=bool)
        return np.asarray(self.case.setup.model.pose(Q)[0][:, 3:] @ np.array(self.case.direction) > 0)
