"""Exact mean and covariance of the tool point for Gaussian errors of the factors.

Independent errors: one walk from the tool to the base carries the mean ``m`` and the *centred* covariance ``C`` of the
tool point in the frame reached so far; raw second moments would lose all digits below 10 µm.

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

import casadi as ca
import numpy as np

from posture_opt.model.chain import ZERO, Scalar, Vector, cos_sin
from posture_opt.robot.robot import Factor

Matrix3 = list[list[Scalar]]
"""(3, 3) scalars, row by row."""


def exact_moments(
    factors: Sequence[Factor],
    values: Sequence[Scalar],
    variances: Sequence[Scalar],
    tip: tuple[Vector, Matrix3] | None = None,
) -> tuple[Vector, Matrix3]:
    """Mean (3,) [m] and covariance (3, 3) [m²] of the tool point in the world.

    Args:
        factors: the chain from the base to the tool.
        values: mean of each factor [rad or m]: numbers, arrays (N,) or CasADi expressions.
        variances: variance of each factor [rad² or m²], the errors being Gaussian and independent.
        tip: moments of the point that the chain carries, in the frame behind it; else a certain point at its origin.
    """
    m, C = tip or (ZERO, no_covariance())
    for factor, value, variance in zip(reversed(factors), reversed(values), reversed(variances), strict=True):
        if factor.kind == "translate":
            m, C = shifted(factor.axis, value, m), widened(factor.axis, variance, C)
            continue
        if not certain(variance):
            m, C = smoothed(factor.axis, variance, m), blurred(factor.axis, variance, m, C)
        c, s = cos_sin(value)
        m, C = turned(factor.axis, c, s, m), turned_covariance(factor.axis, c, s, C)
    return m, C


def no_covariance() -> Matrix3:
    """(3, 3) zeros."""
    return [[0.0] * 3 for _ in range(3)]


def certain(variance: Scalar) -> bool:
    """Whether a variance is the number zero."""
    return isinstance(variance, float) and variance == 0.0


def shifted(k: int, t: Scalar, m: Vector) -> Vector:
    """A vector after a shift by t along axis k."""
    x = list(m)
    x[k] = x[k] + t
    return (x[0], x[1], x[2])


def widened(k: int, v: Scalar, C: Matrix3) -> Matrix3:
    """The covariance after a random shift N(0, v) along axis k."""
    D = [list(row) for row in C]
    D[k][k] = D[k][k] + v
    return D


def smoothed(k: int, v: Scalar, m: Vector) -> Vector:
    """The mean of a vector after a random rotation about axis k by an angle N(0, v)."""
    e1 = _exp(-v / 2)
    x = [e1 * entry for entry in m]
    x[k] = m[k]
    return (x[0], x[1], x[2])


def blurred(k: int, v: Scalar, m: Vector, C: Matrix3) -> Matrix3:
    """The covariance of a vector with mean m after a random rotation about axis k by an angle N(0, v)."""
    i, j = (k + 1) % 3, (k + 2) % 3
    u = -_expm1(-v)
    vc, vs = u * u / 2, -_expm1(-2 * v) / 2
    e1, e2 = _exp(-v / 2), _exp(-2 * v)
    trace, difference = C[i][i] + C[j][j], e2 * (C[i][i] - C[j][j])
    mi2, mj2 = m[i] * m[i], m[j] * m[j]
    D = no_covariance()
    D[i][i] = (trace + difference) / 2 + vc * mi2 + vs * mj2
    D[j][j] = (trace - difference) / 2 + vs * mi2 + vc * mj2
    D[i][j] = D[j][i] = e2 * C[i][j] + (vc - vs) * (m[i] * m[j])
    D[k][k] = C[k][k]
    D[k][i] = D[i][k] = e1 * C[k][i]
    D[k][j] = D[j][k] = e1 * C[k][j]
    return D


def turned(k: int, c: Scalar, s: Scalar, m: Vector) -> Vector:
    """A vector after a certain rotation about axis k, by its cosine and sine."""
    if _is_identity(c, s):
        return m
    i, j = (k + 1) % 3, (k + 2) % 3
    x = list(m)
    x[i], x[j] = c * m[i] - s * m[j], s * m[i] + c * m[j]
    return (x[0], x[1], x[2])


def turned_covariance(k: int, c: Scalar, s: Scalar, C: Matrix3) -> Matrix3:
    """A covariance after a certain rotation about axis k, by its cosine and sine."""
    if _is_identity(c, s):
        return C
    i, j = (k + 1) % 3, (k + 2) % 3
    D = [list(row) for row in C]
    cc, ss, cs = c * c, s * s, c * s
    D[i][i] = cc * C[i][i] + ss * C[j][j] - 2 * cs * C[i][j]
    D[j][j] = ss * C[i][i] + cc * C[j][j] + 2 * cs * C[i][j]
    D[i][j] = D[j][i] = cs * (C[i][i] - C[j][j]) + (cc - ss) * C[i][j]
    D[k][i] = D[i][k] = c * C[k][i] - s * C[k][j]
    D[k][j] = D[j][k] = s * C[k][i] + c * C[k][j]
    return D


def _is_identity(c: Scalar, s: Scalar) -> bool:
    """Whether a rotation is none."""
    return isinstance(s, float) and s == 0.0 and isinstance(c, float) and c == 1.0


def _exp(x: Scalar) -> Scalar:
    """Exponential function of a float, an array or an expression."""
    return math.exp(x) if isinstance(x, float) else np.exp(x) if isinstance(x, np.ndarray) else ca.exp(x)


def _expm1(x: Scalar) -> Scalar:
    """``exp(x) − 1`` without cancellation, of a float, an array or an expression."""
    return math.expm1(x) if isinstance(x, float) else np.expm1(x) if isinstance(x, np.ndarray) else ca.expm1(x)
