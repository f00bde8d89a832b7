"""Exact mean and covariance of the tool point for independent Gaussian errors of the factors.

One walk from the tool to the base carries the mean ``m`` and the *centred* covariance ``C`` of the tool point
in the frame reached so far; raw second moments would lose all digits below 10 µm.

- translation along axis k by ``N(t, v)``:  ``m_k += t``, ``C_kk += v``
- rotation about axis k by ``N(μ, v)``, (i, j) the other two axes: with ``E cos ε = e^{−v/2}``,
  ``Var cos ε = (1 − e^{−v})²/2`` and ``Var sin ε = (1 − e^{−2v})/2`` the errors' moments are

  ``D_ii = (tr + df)/2 + vc m_i² + vs m_j²``,  ``D_jj = (tr − df)/2 + vs m_i² + vc m_j²``,
  ``D_ij = e^{−2v} C_ij + (vc − vs) m_i m_j``,  ``D_ki = e^{−v/2} C_ki``

  with ``tr = C_ii + C_jj`` and ``df = e^{−2v} (C_ii − C_jj)``; then everything turns by the mean angle μ.

As ``v → 0`` this is ``J Σ Jᵀ``. The moments of the cosine and sine of a Gaussian angle are those of its
characteristic function, ``E e^{ikε} = e^{−k²v/2}``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from posture_opt.model.chain import Scalar, Vector, cos_sin
from posture_opt.robot.robot import Factor

Matrix3 = list[list[Scalar]]


def exact_moments(
    factors: Sequence[Factor], values: Sequence[Scalar], variances: Sequence[Scalar]
) -> tuple[Vector, Matrix3]:
    """Mean (3,) [m] and covariance (3, 3) [m²] of the tool point in the world.

    Args:
        factors: the chain from the base to the tool.
        values: mean of each factor [rad or m]: numbers, arrays (N,) or CasADi expressions.
        variances: variance of each factor [rad² or m²], the errors being Gaussian and independent.
    """
    m: list[Scalar] = [0.0, 0.0, 0.0]
    C: Matrix3 = [[0.0] * 3 for _ in range(3)]
    for factor, value, variance in zip(reversed(factors), reversed(values), reversed(variances), strict=True):
        if factor.kind == "translate":
            m[factor.axis] = m[factor.axis] + value
            C[factor.axis][factor.axis] = C[factor.axis][factor.axis] + variance
        else:
            if not (isinstance(variance, float) and variance == 0.0):
                m, C = _blur(factor.axis, variance, m, C)
            m, C = _turn(factor.axis, value, m, C)
    return (m[0], m[1], m[2]), C


def _blur(k: int, v: Scalar, m: list[Scalar], C: Matrix3) -> tuple[list[Scalar], Matrix3]:
    """Moments after a random rotation about axis k by an angle N(0, v)."""
    i, j = (k + 1) % 3, (k + 2) % 3
    u = -_expm1(-v)
    vc, vs = u * u / 2, -_expm1(-2 * v) / 2
    e1, e2 = _exp(-v / 2), _exp(-2 * v)
    trace, difference = C[i][i] + C[j][j], e2 * (C[i][i] - C[j][j])
    mi2, mj2 = m[i] * m[i], m[j] * m[j]
    D: Matrix3 = [[0.0] * 3 for _ in range(3)]
    D[i][i] = (trace + difference) / 2 + vc * mi2 + vs * mj2
    D[j][j] = (trace - difference) / 2 + vs * mi2 + vc * mj2
    D[i][j] = D[j][i] = e2 * C[i][j] + (vc - vs) * (m[i] * m[j])
    D[k][k] = C[k][k]
    D[k][i] = D[i][k] = e1 * C[k][i]
    D[k][j] = D[j][k] = e1 * C[k][j]
    mean: list[Scalar] = list(m)
    mean[i], mean[j] = e1 * m[i], e1 * m[j]
    return mean, D


def _turn(k: int, angle: Scalar, m: list[Scalar], C: Matrix3) -> tuple[list[Scalar], Matrix3]:
    """Moments after a certain rotation about axis k."""
    i, j = (k + 1) % 3, (k + 2) % 3
    c, s = cos_sin(angle)
    if isinstance(s, float) and s == 0.0 and c == 1.0:
        return m, C
    mean: list[Scalar] = list(m)
    mean[i], mean[j] = c * m[i] - s * m[j], s * m[i] + c * m[j]
    D: Matrix3 = [list(row) for row in C]
    cc, ss, cs = c * c, s * s, c * s
    D[i][i] = cc * C[i][i] + ss * C[j][j] - 2 * cs * C[i][j]
    D[j][j] = ss * C[i][i] + cc * C[j][j] + 2 * cs * C[i][j]
    D[i][j] = D[j][i] = cs * (C[i][i] - C[j][j]) + (cc - ss) * C[i][j]
    D[k][i] = D[i][k] = c * C[k][i] - s * C[k][j]
    D[k][j] = D[j][k] = s * C[k][i] + c * C[k][j]
    return mean, D


def _exp(x: Scalar) -> Any:
    return math.exp(x) if isinstance(x, float) else np.exp(x) if isinstance(x, np.ndarray) else ca.exp(x)


def _expm1(x: Scalar) -> Any:
    return math.expm1(x) if isinstance(x, float) else np.expm1(x) if isinstance(x, np.ndarray) else ca.expm1(x)
