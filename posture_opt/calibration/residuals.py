"""Residuals of an arm against measurements and their derivatives, all rows at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from posture_opt.calibration.parameters import Parameter, tool_unknown
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.row_inputs import extended_for
from posture_opt.model.chain import Walk
from posture_opt.model.derivatives import position_column, rotation_column
from posture_opt.model.extension import forward
from posture_opt.numerics import Array, Codes
from posture_opt.robot.robot import Robot

Distance = tuple[int, int, float, float]
"""Codes of two points, their distance [m] and its standard deviation [m]."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Model minus measurement as a function of the deviations ``x`` (k,) of ``parameters`` from nominal [rad, m].

    Args:
        sigma: standard deviation of each measured coordinate [m].
        sigma_rotation: of each component of the measured rotation [rad]; 0 leaves orientations out.
        distances: (first point, second point, distance [m], standard deviation [m]) known between points.
    """

    robot: Robot
    data: Measurements
    parameters: tuple[Parameter, ...]
    sigma: float
    sigma_rotation: float = 0.0
    distances: tuple[Distance, ...] = ()

    @property
    def oriented(self) -> bool:
        return self.sigma_rotation > 0 and self.data.rotation is not None

    @property
    def axes(self) -> Codes:
        """Coordinates of the position that were measured."""
        return np.flatnonzero(self.data.measured_axes) if self.data.position is not None else np.arange(3)

    @property
    def block(self) -> int:
        """The number of residuals of one row."""
        return len(self.axes) + 3 * self.oriented

    @property
    def free_groups(self) -> frozenset[str]:
        """The groups of parameters that are fitted to the nominal arm too: touched points and free frames.

        Several targets are several points of one tool, of which the file can state but one: their offsets are free.
        """
        free = {"point": True, "base": self.robot.base_free, "tool": tool_unknown(self.robot, self.data)}
        return frozenset(group for group, is_free in free.items() if is_free)

    @property
    def free(self) -> Codes:
        """(f,) the parameters of those groups."""
        return np.array([i for i, p in enumerate(self.parameters) if p.group in self.free_groups], dtype=np.intp)

    def take(self, rows: Codes) -> Residuals:
        """The residuals of some rows."""
        return Residuals(
            self.robot, self.data.take(rows), self.parameters, self.sigma, self.sigma_rotation, self.distances
        )

    def walk(self, x: Array) -> Walk:
        """The chain at all rows with the deviations ``x``."""
        values: dict[str, Any] = {}
        for parameter, deviation in zip(self.parameters, x, strict=True):
            if parameter.factor < 0:
                continue
            name = self.robot.factors[parameter.factor].parameter
            if parameter.code < 0:
                values[name] = float(deviation)
            else:
                rows = values.setdefault(name, np.zeros(len(self.data)))
                rows[self.data.target == parameter.code] = deviation
        q = [np.ascontiguousarray(column) for column in self.data.q.T]
        return forward(extended_for(self.robot, self.data), q, values)[0]

    def error(self, x: Array, reached: Walk | None = None) -> Array:
        """Position of the model minus the measured one (N, 3) [m]; of touched points, minus the point."""
        reached = reached or self.walk(x)
        position = _stacked(reached.position, len(self.data))
        if self.data.position is not None:
            return position - self.data.position
        return position - self.points(x)[self.data.point]

    def points(self, x: Array) -> Array:
        """The touched points (P, 3) [m] among the deviations ``x``."""
        points = np.zeros((len(self.data.point_names), 3))
        for parameter, value in zip(self.parameters, x, strict=True):
            if parameter.group == "point":
                points[parameter.code, parameter.axis] = parameter.nominal + value
        return points

    def rotation_error(self, reached: Walk) -> Array:
        """Rotation vector (N, 3) [rad] in the world that turns the measured orientation into the model's."""
        assert self.data.rotation is not None
        R = np.stack([_stacked(column, len(self.data)) for column in reached.columns], axis=-1)
        return rotation_vectors(R @ np.swapaxes(matrices(self.data.rotation), -1, -2))

    def whitened(self, x: Array) -> Array:
        """Residuals (N·block + distances,) in units of the instrument's σ."""
        return self._vector(x, self.walk(x))

    def both(self, x: Array) -> tuple[Array, Array]:
        """Whitened residuals (m,) and their Jacobian (m, k)."""
        reached = self.walk(x)
        return self._vector(x, reached), self._jacobian(x, reached)

    def _vector(self, x: Array, reached: Walk) -> Array:
        parts = [self.error(x, reached)[:, self.axes] / self.sigma]
        if self.oriented:
            parts.append(self.rotation_error(reached) / self.sigma_rotation)
        rows = np.concatenate(parts, axis=1).ravel()
        return np.concatenate([rows, self._distance_residuals(x)[0]])

    def _jacobian(self, x: Array, reached: Walk) -> Array:
        N, axes = len(self.data), self.axes
        J = np.zeros((len(self.parameters), N, self.block))
        for k, parameter in enumerate(self.parameters):
            if parameter.factor < 0:
                J[k, self.data.point == parameter.code, parameter.axis] = -1.0 / self.sigma
                continue
            column = position_column(reached, parameter.factor)
            for slot, axis in enumerate(axes):
                J[k, :, slot] = column[axis] / self.sigma
            if self.oriented:
                turn = rotation_column(reached, parameter.factor)
                for axis in range(3):
                    J[k, :, len(axes) + axis] = turn[axis] / self.sigma_rotation
            if parameter.code >= 0:
                J[k, self.data.target != parameter.code] = 0.0
        dense = J.reshape(len(self.parameters), -1).T
        return np.concatenate([dense, self._distance_residuals(x)[1]]) if self.distances else dense

    def _distance_residuals(self, x: Array) -> tuple[Array, Array]:
        r = np.zeros(len(self.distances))
        J = np.zeros((len(self.distances), len(self.parameters)))
        points = self.points(x) if self.distances else np.zeros((0, 3))
        for row, (a, b, length, sigma) in enumerate(self.distances):
            between = points[a] - points[b]
            reached = max(float(np.linalg.norm(between)), 1e-12)
            r[row] = (reached - length) / sigma
            for k, parameter in enumerate(self.parameters):
                if parameter.group == "point" and parameter.code in (a, b):
                    J[row, k] = (1 if parameter.code == a else -1) * between[parameter.axis] / reached / sigma
        return r, J


def _stacked(vector: Sequence[Any], n: int) -> Array:
    return np.stack([np.broadcast_to(np.asarray(entry, dtype=float), (n,)) for entry in vector], axis=-1)


def matrices(quaternions: Array) -> Array:
    """Rotation matrices (N, 3, 3) of unit quaternions (N, 4), w first."""
    w, x, y, z = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def rotation_vectors(R: Array) -> Array:
    """Rotation vectors (N, 3) [rad] of rotation matrices (N, 3, 3), by way of the quaternion."""
    skew = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=-1) / 2
    sine = np.linalg.norm(skew, axis=-1)
    angle = np.arctan2(sine, (np.trace(R, axis1=-2, axis2=-1) - 1) / 2)
    ratio = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), 1.0)
    return skew * ratio[:, None]
