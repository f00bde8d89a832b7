"""Small symmetric systems solved by L D Lᵀ, written out as expressions: the graph has no loops and no branches."""

from __future__ import annotations

import math

import casadi as ca

Factors = tuple[list[list[ca.SX]], list[ca.SX]]
"""The strict lower triangle of L and the diagonal D."""

_LEAST_PIVOT = 1e-9  # of the largest diagonal entry, where a matrix is made positive definite


def ldl(A: ca.SX, floor: float = 0.0) -> Factors:
    """L D Lᵀ of a symmetric positive definite (n, n) matrix; pivots below ``floor`` are raised to it."""
    n = A.shape[0]
    L: list[list[ca.SX]] = [[ca.SX(0)] * n for _ in range(n)]
    D: list[ca.SX] = []
    for j in range(n):
        pivot = A[j, j] - sum((L[j][k] ** 2 * D[k] for k in range(j)), ca.SX(0))
        D.append(ca.fmax(pivot, floor) if floor else pivot)
        for i in range(j + 1, n):
            L[i][j] = (A[i, j] - sum((L[i][k] * L[j][k] * D[k] for k in range(j)), ca.SX(0))) / D[j]
    return L, D


def modified_ldl(A: ca.SX) -> tuple[Factors, ca.SX]:
    """L D Lᵀ of a positive definite matrix near the symmetric ``A`` (n, n), and whether A had a negative pivot.

    Gill, Murray and Wright (1981, section 4.4.2.2): pivots are made positive and so large that L stays bounded; a
    matrix that is well inside of the positive definite ones is left as it is.
    """
    n = A.shape[0]
    diagonal = ca.mmax(ca.fabs(ca.diag(A)))
    across = ca.mmax(ca.fabs(ca.vec(A - ca.diag(ca.diag(A))))) if n > 1 else ca.SX(0)
    bound = ca.fmax(diagonal, across / math.sqrt(max(n * n - 1, 1)))
    least = _LEAST_PIVOT * diagonal + 1e-300
    L: list[list[ca.SX]] = [[ca.SX(0)] * n for _ in range(n)]
    C: list[list[ca.SX]] = [[ca.SX(0)] * n for _ in range(n)]
    D: list[ca.SX] = []
    negative = ca.SX(0)
    for j in range(n):
        for i in range(j, n):
            C[i][j] = A[i, j] - sum((L[j][k] * C[i][k] for k in range(j)), ca.SX(0))
        below = [ca.fabs(C[i][j]) for i in range(j + 1, n)]
        widest = ca.mmax(ca.vertcat(*below)) if below else ca.SX(0)
        D.append(ca.fmax(ca.fmax(ca.fabs(C[j][j]), widest**2 / bound), least))
        negative = ca.fmax(negative, C[j][j] < -least)
        for i in range(j + 1, n):
            L[i][j] = C[i][j] / D[j]
    return (L, D), negative


def solved(factors: Factors, b: ca.SX) -> ca.SX:
    """(n,) the solution of ``L D Lᵀ x = b``."""
    L, D = factors
    n = len(D)
    y: list[ca.SX] = []
    for i in range(n):
        y.append(b[i] - sum((L[i][k] * y[k] for k in range(i)), ca.SX(0)))
    x: list[ca.SX] = [ca.SX(0)] * n
    for i in reversed(range(n)):
        x[i] = y[i] / D[i] - sum((L[k][i] * x[k] for k in range(i + 1, n)), ca.SX(0))
    return ca.vertcat(*x)
