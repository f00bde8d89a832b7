"""Exact mean and covariance of the tool point of a planar arm, for Gaussian errors correlated in any way.

With the plane as complex numbers the tool point is ``z = Σ_m ℓ_m e^{i(ψ_m + S_m)}``: ``ℓ_m`` the length of translation
m, ``ψ_m`` its direction, ``S_m`` the sum of the angular errors nearer to the base. For jointly Gaussian ℓ and S all
moments follow from the characteristic function, e.g. ``E[ℓ e^{iS}] = (μ + i Cov(ℓ, S)) e^{−Var(S)/2}``. Covariances are
formed with ``expm1`` and keep their digits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.model.chain import Scalar, Vector, Walk, add, dot, factor_values, scale, walk
from posture_opt.robot.robot import Robot

Complex = tuple[Scalar, Scalar]
"""Real and imaginary part, so that symbols serve too."""


@dataclass(frozen=True)
class Plane:
    """The plane that a planar arm moves in.

    Args:
        e1, e2: (3,) orthonormal basis, world.
        normal: (3,) ``e1 × e2``, world.
    """

    e1: Vector
    e2: Vector
    normal: Vector


def plane_of(robot: Robot, uncertain: Sequence[int] = ()) -> Plane | None:
    """The plane of motion, or None where the joints (or the uncertain factors) turn about different axes.

    Args:
        robot: the chain.
        uncertain: indices of factors with an error.
    """
    rng = np.random.default_rng(0)
    normals = []
    for _ in range(3):
        reached = walk(robot.factors, factor_values(robot.factors, [float(v) for v in rng.uniform(-1, 1, robot.n)]))
        for index, factor in enumerate(robot.factors):
            if factor.kind == "rotate" and (factor.joint is not None or index in uncertain):
                normals.append(np.array(reached.screws[index].axis, dtype=float))
    if not normals or any(np.linalg.norm(np.cross(normals[0], axis)) > 1e-12 for axis in normals):
        return None
    n = normals[0]
    helper = np.eye(3)[np.argmin(np.abs(n))]
    e1 = helper - n * (helper @ n)
    e1 /= np.linalg.norm(e1)
    return Plane(_as_vector(e1), _as_vector(np.cross(n, e1)), _as_vector(n))


@dataclass(frozen=True)
class _Arrow:
    """One translation of the chain: its length, its direction in the plane and along the normal, its sources."""

    length: Scalar
    direction: Complex
    height: float
    of_length: np.ndarray  # (k,) 1 where a source adds to the length
    of_angle: np.ndarray  # (k,) ±1 where a source turns the arrow


def planar_moments(
    robot: Robot, reached: Walk, lengths: Sequence[Scalar], indices: Sequence[int], covariance: np.ndarray, plane: Plane
) -> tuple[Vector, list[list[Scalar]]]:
    """Exact mean (3,) [m] and covariance (3, 3) [m²] of the tool point, world frame.

    Args:
        robot: a planar arm.
        reached: its walk at the posture.
        lengths: value of every factor at the posture.
        indices: (k,) factor that each source acts on.
        covariance: (k, k) Σ of the sources.
        plane: from :func:`plane_of` with the same ``indices``.
    """
    arrows = _chain_arrows(robot, reached, lengths, indices, plane)
    mean: list[Scalar] = [0.0, 0.0, 0.0]
    power: Scalar = 0.0
    pseudo: Complex = (0.0, 0.0)
    height: Scalar = 0.0
    lift: Complex = (0.0, 0.0)
    for m in arrows:
        z = _complex_product(_arrow_mean(m, covariance), m.direction)
        mean = [mean[0] + z[0], mean[1] + z[1], mean[2] + m.height * m.length]
        for n in arrows:
            power = (
                power
                + _complex_product(
                    _arrow_covariance(m, n, covariance, -1), _complex_product(m.direction, _conjugate(n.direction))
                )[0]
            )
            pseudo = _complex_sum(
                pseudo,
                _complex_product(_arrow_covariance(m, n, covariance, +1), _complex_product(m.direction, n.direction)),
            )
            height = height + m.height * n.height * float(m.of_length @ covariance @ n.of_length)
            lift = _complex_sum(lift, _complex_product(_height_covariance(m, n, covariance), n.direction))
    xx, yy, xy = (power + pseudo[0]) / 2, (power - pseudo[0]) / 2, pseudo[1] / 2
    local = [[xx, xy, lift[0]], [xy, yy, lift[1]], [lift[0], lift[1], height]]
    basis = (plane.e1, plane.e2, plane.normal)
    total = add(add(scale(mean[0], plane.e1), scale(mean[1], plane.e2)), scale(mean[2], plane.normal))
    world = [
        [sum(basis[a][r] * local[a][b] * basis[b][c] for a in range(3) for b in range(3)) for c in range(3)]
        for r in range(3)
    ]
    return total, world


def _chain_arrows(
    robot: Robot, reached: Walk, lengths: Sequence[Scalar], indices: Sequence[int], plane: Plane
) -> list[_Arrow]:
    """The translations of the chain that have a length, an error or a joint, with what turns them."""
    # The angle of an axis to the normal does not depend on the posture: a number, whatever the walk is made of.
    fixed = walk(robot.factors, factor_values(robot.factors, [0.3] * robot.n))
    arrows = []
    turned_by = np.zeros(len(indices))
    for i, factor in enumerate(robot.factors):
        acts = np.array([1.0 if index == i else 0.0 for index in indices])
        axis, height = reached.screws[i].axis, float(dot(fixed.screws[i].axis, plane.normal))
        if factor.kind == "rotate":
            if acts.any():
                turned_by = turned_by + acts * (1.0 if height > 0 else -1.0)
        elif acts.any() or factor.joint is not None or factor.nominal:
            arrows.append(_Arrow(lengths[i], (dot(axis, plane.e1), dot(axis, plane.e2)), height, acts, turned_by))
    return arrows


def _arrow_mean(m: _Arrow, S: np.ndarray) -> Complex:
    """``E[ℓ e^{iS}] = (μ + i Cov(ℓ, S)) e^{−Var(S)/2}`` [m] of one arrow."""
    half = math.exp(-float(m.of_angle @ S @ m.of_angle) / 2)
    return (half * m.length, half * float(m.of_length @ S @ m.of_angle))


def _arrow_covariance(m: _Arrow, n: _Arrow, S: np.ndarray, sign: int) -> Complex:
    """``Cov(ℓ_m e^{iS_m}, ℓ_n e^{± iS_n})`` (sign −1: with the conjugate, which makes it the Hermitian one)."""
    c = -sign * float(m.of_angle @ S @ n.of_angle)
    both = math.exp(-float(m.of_angle @ S @ m.of_angle + n.of_angle @ S @ n.of_angle) / 2)
    A: Complex = (m.length, float(m.of_length @ S @ m.of_angle))
    B: Complex = (n.length, sign * float(n.of_length @ S @ n.of_angle))
    alpha, beta = sign * float(m.of_length @ S @ n.of_angle), float(n.of_length @ S @ m.of_angle)
    AB = _complex_product(A, B)
    # (A + iα)(B + iβ) − A B + Cov(ℓ_m, ℓ_n), formed without the cancellation
    extra = _complex_sum(_complex_product((0.0, alpha), B), _complex_product(A, (0.0, beta)))
    extra = (extra[0] - alpha * beta + float(m.of_length @ S @ n.of_length), extra[1])
    grow, less = both * math.exp(c), both * math.expm1(c)
    return (less * AB[0] + grow * extra[0], less * AB[1] + grow * extra[1])


def _height_covariance(m: _Arrow, n: _Arrow, S: np.ndarray) -> Complex:
    """``Cov(height of m, ℓ_n e^{iS_n})``."""
    half = m.height * math.exp(-float(n.of_angle @ S @ n.of_angle) / 2)
    turn = float(m.of_length @ S @ n.of_angle)
    shift = float(m.of_length @ S @ n.of_length) - turn * float(n.of_length @ S @ n.of_angle)
    return (half * shift, half * turn * n.length)


def _complex_product(u: Complex, v: Complex) -> Complex:
    """``u v``."""
    return (u[0] * v[0] - u[1] * v[1], u[0] * v[1] + u[1] * v[0])


def _complex_sum(u: Complex, v: Complex) -> Complex:
    """``u + v``."""
    return (u[0] + v[0], u[1] + v[1])


def _conjugate(u: Complex) -> Complex:
    """The complex conjugate of u."""
    return (u[0], -u[1])


def _as_vector(array: np.ndarray) -> Vector:
    """(3,) plain floats."""
    return (float(array[0]), float(array[1]), float(array[2]))
