"""Small symmetric systems solved by L D Lᵀ, written out as expressions: the graph has no loops and no branches."""

from __future__ import annotations

import casadi as ca

Factors = tuple[list[list[ca.SX]], list[ca.SX]]  # The strict lower triangle of L and the diagonal D


def ldl(A: ca.SX, dependent: float = 0.0) -> Factors:
    """L D Lᵀ of a symmetric (n, n) matrix without pivoting. Where a pivot is below ``dependent`` of its diagonal entry,
    the row depends on those before it: the unknown of such a row of a positive semidefinite matrix is solved to be
    zero. A: (n, n) expressions; only the lower triangle is read. n³/6 operations: for n up to ten or so."""
    n = A.shape[0]
    L: list[list[ca.SX]] = [[ca.SX(0)] * n for _ in range(n)]
    D: list[ca.SX] = []
    for j in range(n):
        pivot = A[j, j] - sum((L[j][k] ** 2 * D[k] for k in range(j)), ca.SX(0))
        # A pivot that makes its unknown zero; its square would still be a number.
        D.append(ca.if_else(pivot > dependent * A[j, j], pivot, 1e200) if dependent else pivot)
        for i in range(j + 1, n):
            L[i][j] = (A[i, j] - sum((L[i][k] * L[j][k] * D[k] for k in range(j)), ca.SX(0))) / D[j]
    return L, D


def solved(factors: Factors, b: ca.SX) -> ca.SX:
    """(n,) the solution x of ``L D Lᵀ x = b``, b (n,), by forward and backward substitution."""
    L, D = factors
    n = len(D)
    y: list[ca.SX] = []
    for i in range(n):
        y.append(b[i] - sum((L[i][k] * y[k] for k in range(i)), ca.SX(0)))
    x: list[ca.SX] = [ca.SX(0)] * n
    for i in reversed(range(n)):
        x[i] = y[i] / D[i] - sum((L[k][i] * x[k] for k in range(i + 1, n)), ca.SX(0))
    return ca.vertcat(*x)
