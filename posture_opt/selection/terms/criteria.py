"""Numbers that sum up a projected covariance C (m, m) [m²], as smooth expressions: the criteria of a task.

The largest eigenvalue has a kink where two eigenvalues coincide, and making it small often makes them equal. So
eigenvalues are rounded off by a fixed fraction of the trace. All functions take and return CasADi expressions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca

# Eigenvalues are not smooth where two coincide; this fraction of the trace rounds the corner off and costs the
# optimum less than 1e-4 of its variance.
_ROUNDING = 1e-4


def eigenvalues(C: ca.SX) -> list[ca.SX]:
    """Eigenvalues of a symmetric (m, m) matrix, m ≤ 3, ascending, rounded where they meet.

    For m = 2, mean t and rounding ε: ``λ = t ± sqrt(((c₁₁ − c₂₂)/2)² + c₁₂² + (ε t)²)``, too large by at most ε t.
    """
    m = C.shape[0]
    if m == 1:
        return [C[0, 0]]
    if m == 2:
        mean, half = (C[0, 0] + C[1, 1]) / 2, (C[0, 0] - C[1, 1]) / 2
        radius = ca.sqrt(half**2 + C[0, 1] ** 2 + (_ROUNDING * mean) ** 2)
        return [mean - radius, mean + radius]
    return _eigenvalues_3(C)


def worst_across(C: ca.SX, axis: ca.SX) -> ca.SX:
    """Largest eigenvalue [m²] of C (3, 3) across a unit vector a: those of ``P C P``, ``P = I − a aᵀ``, have the sum
    ``tr C − aᵀ C a`` and the product ``aᵀ adj(C) a``; no basis across a is needed.
    """
    mean = (ca.trace(C) - ca.dot(axis, C @ axis)) / 2
    columns = [C[:, k] for k in range(3)]
    minors = ca.vertcat(*(ca.dot(axis, ca.cross(columns[k - 2], columns[k - 1])) for k in range(3)))
    return mean + ca.sqrt(ca.fmax(mean**2 - ca.dot(axis, minors), 0) + (_ROUNDING * mean) ** 2 + 1e-36)


def _eigenvalues_3(C: ca.SX) -> list[ca.SX]:
    """``λ_k = t + 2 p cos(θ + 2πk/3)``, ``6 p² = ‖C − t I‖²``, ``cos 3θ = det(C − t I)/(2 p³)`` (Smith 1961)."""
    mean = ca.trace(C) / 3
    D = C - mean * ca.SX.eye(3)
    p = ca.sqrt(ca.sumsqr(D) / 6 + (_ROUNDING * mean) ** 2)
    r = _det3(D) / (2 * p**3)
    angle = ca.acos(ca.fmin(ca.fmax(r, -1 + 1e-9), 1 - 1e-9)) / 3
    return [mean + 2 * p * ca.cos(angle + shift) for shift in (2 * math.pi / 3, -2 * math.pi / 3, 0.0)]


def _det3(M: ca.SX) -> ca.SX:
    """The determinant of a (3, 3) matrix, as the triple product of its columns."""
    return ca.dot(M[:, 0], ca.cross(M[:, 1], M[:, 2]))


def worst(C: ca.SX) -> ca.SX:
    """Largest eigenvalue [m²]: the variance along the worst axis, the square of ``sigma_max`` up to the rounding."""
    return eigenvalues(C)[-1]


def largest(variances: Sequence[ca.SX]) -> ca.SX:
    """The largest of some variances [m²], two by two the rounded eigenvalues of a diagonal matrix."""
    found = variances[0]
    for other in variances[1:]:
        found = eigenvalues(ca.diag(ca.vertcat(found, other)))[-1]
    return found


def trace(C: ca.SX) -> ca.SX:
    """Sum of the variances [m²]: the mean square distance."""
    return ca.trace(C)


def area(C: ca.SX) -> ca.SX:
    """``det(C)^(1/m)`` [m²]; ``(ε tr C/m)^m`` is added, as the root has no slope at a singular posture."""
    m = C.shape[0]
    if m == 1:
        return C[0, 0]
    mean = ca.trace(C) / m
    if m == 2:
        return ca.sqrt(C[0, 0] * C[1, 1] - C[0, 1] ** 2 + (_ROUNDING * mean) ** 2)
    return (_det3(C) + (_ROUNDING * mean) ** 3) ** (1 / 3)


def log_miss(C: ca.SX, bias: ca.SX, clearance: ca.SX) -> ca.SX:
    """Logarithm of the probability that a Gaussian point, covariance C (m, m) [m²], mean ``bias`` (m,) [m], misses.

    With ``x = b + ρ L u(φ)``, L Lᵀ = C, it leaves the circle of radius c = ``clearance`` [m] at ``ρ*(φ)``:
    ``P = (1/2π) ∫ exp(−ρ*²/2) dφ``; the periodic trapezoid rule converges exponentially. In space ``exp(−ρ*²/2)``
    becomes ``erfc(ρ*/√2) + √(2/π) ρ* exp(−ρ*²/2)``. |bias| < clearance.
    """
    m = C.shape[0]
    if m == 1:
        sigma = ca.sqrt(C[0, 0])
        return _log_tail((clearance - bias[0]) / sigma, (clearance + bias[0]) / sigma)
    root, gap = _lower_root(C), clearance**2 - ca.sumsqr(bias)
    tails = []
    for direction in _circle() if m == 2 else _sphere():
        d = root @ ca.DM(direction)
        alpha, beta = ca.sumsqr(d), ca.dot(bias, d)
        rho = gap / (beta + ca.sqrt(beta**2 + alpha * gap))
        in_space = ca.log(_scaled_erfc(rho) + math.sqrt(2 / math.pi) * rho) if m == 3 else 0.0
        tails.append(in_space - rho**2 / 2)
    return ca.logsumexp(ca.vertcat(*tails)) - math.log(len(tails))


def _lower_root(C: ca.SX) -> ca.SX:
    m, tiny = C.shape[0], 1e-12 * ca.trace(C)
    L = ca.SX(m, m)
    for i in range(m):
        for j in range(i + 1):
            rest = C[i, j] - ca.dot(L[i, :j], L[j, :j])
            L[i, j] = ca.sqrt(rest + tiny) if i == j else rest / L[j, j]
    return L


def _circle() -> list[list[float]]:
    turns = (2 * math.pi * k / 48 for k in range(48))  # 48: the logarithm is right to 1e-6 for axes up to 1 : 30
    return [[math.cos(turn), math.sin(turn)] for turn in turns]


def _sphere() -> list[list[float]]:
    """A spiral of equal areas (R. Swinbank and R. J. Purser, Q. J. R. Meteorol. Soc. 132 (2006) 1769)."""
    golden = math.pi * (3 - math.sqrt(5))
    heights = [1 - (2 * k + 1) / 192 for k in range(192)]  # right to 0.05 where one in a thousand misses
    across = [math.sqrt(1 - z * z) for z in heights]
    return [
        [r * math.cos(golden * k), r * math.sin(golden * k), z]
        for k, (r, z) in enumerate(zip(across, heights, strict=True))
    ]


def _log_tail(*distances: ca.SX) -> ca.SX:
    """Logarithm of the mean of two Gaussian tails ``Q(z) = erfc(z/√2)/2``, with a slope far out."""
    terms = []
    for z in distances:
        terms.append(-(z**2) / 2 + ca.log(_scaled_erfc(z) / 2))
    return ca.logsumexp(ca.vertcat(*terms))


def _scaled_erfc(z: ca.SX) -> ca.SX:
    """``exp(z²/2) erfc(z/√2)``: Abramowitz and Stegun (1964) 7.1.26, within 1 % to z = 8, 7 % at 20: to be led by."""
    t = 1 / (1 + 0.3275911 * z / math.sqrt(2))
    return t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
