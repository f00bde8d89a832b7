"""The arm and its covariance for the brute force: written anew from the chain's factors, nothing of the search.

The exact moments of independent errors follow the recursion of section 7a of the references (mean and centred
covariance carried from the tool to the base); what correlations add is taken to first order, as the search defines
it. `check` holds both against NumPy and a Monte Carlo cloud.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from posture_opt.model.compiled import BatchFunction
from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor, Robot

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
FULL = (0, 1, 2, 1, 3, 4, 2, 4, 5)


@dataclass(frozen=True)
class Evaluated:
    """Tool point (N, 3), tool axis (N, 3), covariance (N, 3, 3), bias (N, 3), and their slopes (N, …, n)."""

    position: Array
    axis: Array
    covariance: Array
    bias: Array
    d_position: Array
    d_axis: Array
    d_covariance: Array
    d_bias: Array


@dataclass(frozen=True, eq=False)
class Model:
    """The forward model of one arm, tool axis (3,) and covariance of named parameters."""

    robot: Robot
    tool_axis: tuple[float, float, float]
    names: tuple[str, ...]
    covariance: Array

    @cached_property
    def pose(self) -> BatchFunction:
        """Postures (N, n) to tool point and axis (N, 6) and their Jacobian (N, 6, n)."""
        q = ca.SX.sym("q", self.robot.n)
        y = self._pose(q, {})
        return BatchFunction(ca.Function("fleet_pose", [q], [y, ca.densify(ca.jacobian(y, q))]))

    @cached_property
    def _moments(self) -> BatchFunction:
        q = ca.SX.sym("q", self.robot.n)
        pose = self._pose(q, {})
        mean, C = self._exact(q)
        C = C + self._of_correlation(q)
        y = ca.densify(ca.vertcat(pose, *(C[i, j] for i, j in PAIRS), mean - pose[:3]))
        outputs = ca.cse([y, ca.densify(ca.jacobian(y, q))])
        return BatchFunction(ca.Function("fleet_moments", [q], outputs))

    def __call__(self, Q: Array) -> Evaluated:
        """Everything at postures (N, n)."""
        y, J = self._moments(Q)
        C, dC = (a[:, 6:12][:, FULL].reshape(len(Q), 3, 3, *a.shape[2:]) for a in (y, J))
        return Evaluated(y[:, :3], y[:, 3:6], C, y[:, 12:], J[:, :3], J[:, 3:6], dC, J[:, 12:])

    def _value(self, factor: Factor, q: ca.SX) -> ca.SX:
        return factor.nominal + (0 if factor.joint is None else q[factor.joint])

    def _pose(self, q: ca.SX, errors: dict[str, ca.SX]) -> ca.SX:
        a = np.array(self.tool_axis) / np.linalg.norm(self.tool_axis)
        point, axis = ca.SX.zeros(3), ca.SX(ca.DM(a))
        for f in reversed(self.robot.factors):
            value = self._value(f, q) + errors.get(f.parameter, 0)
            if f.kind == "translate":
                point = point + value * _unit(f.axis)
            else:
                R = _turn(f.axis, value)
                point, axis = R @ point, R @ axis
        return ca.vertcat(point, axis)

    def _exact(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        variances = dict(zip(self.names, np.diag(self.covariance).tolist(), strict=True))
        mean, C = ca.SX.zeros(3), ca.SX.zeros(3, 3)
        for f in reversed(self.robot.factors):
            v, value = variances.get(f.parameter, 0.0), self._value(f, q)
            if f.kind == "translate":
                mean, C = mean + value * _unit(f.axis), C + v * ca.diag(_unit(f.axis))
            else:
                mean, C = _blurred(mean, C, f.axis, v) if v else (mean, C)
                R = _turn(f.axis, value)
                mean, C = R @ mean, R @ C @ R.T
        return mean, C

    def _of_correlation(self, q: ca.SX) -> ca.SX:
        off = self.covariance - np.diag(np.diag(self.covariance))
        if not np.any(off):
            return ca.SX.zeros(3, 3)
        e = ca.SX.sym("e", len(self.names))
        errors = dict(zip(self.names, ca.vertsplit(e), strict=True))
        J = ca.substitute(ca.jacobian(self._pose(q, errors)[:3], e), e, ca.DM.zeros(len(self.names)))
        return J @ ca.DM(off) @ J.T


def _unit(axis: int) -> ca.SX:
    return ca.SX(ca.DM(np.eye(3)[axis]))


def _turn(axis: int, angle: ca.SX) -> ca.SX:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = ca.SX.eye(3)
    c, s = ca.cos(angle), ca.sin(angle)
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def _blurred(m: ca.SX, C: ca.SX, k: int, v: float) -> tuple[ca.SX, ca.SX]:
    """Mean and covariance after a rotation about axis k by a Gaussian angle of mean 0 and variance v."""
    i, j = (k + 1) % 3, (k + 2) % 3
    vc, vs = np.expm1(-v) ** 2 / 2, -np.expm1(-2 * v) / 2
    e1, e2 = float(np.exp(-v / 2)), float(np.exp(-2 * v))
    trace, difference = C[i, i] + C[j, j], e2 * (C[i, i] - C[j, j])
    D, mean = ca.SX(C), ca.SX(m)
    D[i, i] = (trace + difference) / 2 + vc * m[i] ** 2 + vs * m[j] ** 2
    D[j, j] = (trace - difference) / 2 + vs * m[i] ** 2 + vc * m[j] ** 2
    D[i, j] = D[j, i] = e2 * C[i, j] + (vc - vs) * m[i] * m[j]
    for other in (i, j):
        D[k, other] = D[other, k] = e1 * C[k, other]
        mean[other] = e1 * m[other]
    return mean, D
