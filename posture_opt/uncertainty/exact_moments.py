"""Exact mean and covariance of the tool point for Gaussian errors: independent, with shared parts, or of planar arms.

Independent errors: one walk from the tool to the base carries the mean ``m`` and the *centred* covariance ``C`` of the
tool point in the frame reached so far; raw second moments would lose all digits below 10 µm.

- translation along axis k by ``N(t, v)``:  ``m_k += t``, ``C_kk += v``
- rotation about axis k by ``N(μ, v)``, (i, j) the other two axes: with ``E cos ε = e^{−v/2}``,
  ``Var cos ε = (1 − e^{−v})²/2`` and ``Var sin ε = (1 − e^{−2v})/2`` the errors' moments are

  ``D_ii = (tr + df)/2 + vc m_i² + vs m_j²``,  ``D_jj = (tr − df)/2 + vs m_i² + vc m_j²``,
  ``D_ij = e^{−2v} C_ij + (vc − vs) m_i m_j``,  ``D_ki = e^{−v/2} C_ki``

  with ``tr = C_ii + C_jj`` and ``df = e^{−2v} (C_ii − C_jj)``; then everything turns by the mean angle μ.

As ``v → 0`` this is ``J Σ Jᵀ``. The moments follow from the characteristic function, ``E e^{ikε} = e^{−k²v/2}``.

Shared factors z of `SharedFactors`: given z the errors are independent with means ``L z``, and by the law of total
covariance ``C = E C(z) + Cov m(z)``, both positive semidefinite with nodes of positive weight. The mean at a node is
carried as its deviation d from the mean at z = 0: ``R(α) (m + d) − m`` with ``cos α − 1 = −2 sin² α/2``, so that
``Σ w d dᵀ`` keeps its digits however small the errors are. Nodes cost their number of walks along a `Segment` alone:
behind the outermost source of a factor the chain does not know of it, before the innermost only the mixture counts.

Planar arms, errors correlated in any way: with the plane as complex numbers the tool point is ``z = Σ_m ℓ_m e^{i(ψ_m +
S_m)}``, ``ℓ_m`` the length of translation m, ``ψ_m`` its direction, ``S_m`` the sum of the angular errors nearer to the
base. For jointly Gaussian ℓ and S all moments follow from the characteristic function, e.g. ``E[ℓ e^{iS}] =
(μ + i Cov(ℓ, S)) e^{−Var(S)/2}``. Covariances are formed with ``expm1`` and keep their digits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from posture_opt.model.chain import ZERO, Scalar, Vector, Walk, add, cos_sin, dot, factor_values, scale, walk
from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor, Robot
from posture_opt.uncertainty.gaussian_rules import Nodes

Matrix3 = list[list[Scalar]]  # (3, 3) scalars, row by row


@dataclass(frozen=True, eq=False)
class Segment:
    """The part of a chain along which r shared factors act, and the nodes for them."""

    first: int  # place in the chain; last: likewise, included
    last: int
    loadings: Mapping[int, Array]  # place -> (r,) or (..., r) standard deviation there by each factor [rad or m]
    centre: Nodes  # where the mean is taken, whose covariance counts
    width: Nodes  # where the covariance is taken, whose mean counts; the same, or fewer


class _Shift(NamedTuple):
    """What the nodes add to one factor."""

    size: Scalar  # [rad or m]
    sine: Scalar
    cosine_less_one: Scalar


def exact_moments(
    factors: Sequence[Factor],
    values: Sequence[Scalar],
    variances: Sequence[Scalar],
    tip: tuple[Vector, Matrix3] | None = None,
) -> tuple[Vector, Matrix3]:
    """Mean (3,) [m] and covariance (3, 3) [m²] in front of the factors of a point behind them, ``tip`` or the origin.

    ``values`` [rad or m] and ``variances`` [rad² or m²] are numbers, arrays (N,) or CasADi expressions.
    """
    m, C = tip or (ZERO, _no_covariance())
    m, _, C = _walked(factors, values, variances, [None] * len(factors), m, C)  # type: ignore[assignment]
    return m, C


def conditional_moments(
    factors: Sequence[Factor], values: Sequence[Scalar], own: Sequence[Scalar], segments: Sequence[Segment]
) -> tuple[Vector, Matrix3]:
    """Mean (3,) [m] and covariance (3, 3) [m²] of the tool point, world, mixed over the nodes of disjoint segments.

    ``values`` and ``own``, the variances given the shared factors, are numbers, arrays (..., 1) or expressions.
    """
    m, C, end = ZERO, _no_covariance(), len(factors)
    for segment in sorted(segments, key=lambda segment: -segment.last):
        behind, within = slice(segment.last + 1, end), slice(segment.first, segment.last + 1)
        m, C = exact_moments(factors[behind], values[behind], own[behind], (m, C))
        m, C = _mixed_moments(segment, factors[within], values[within], own[within], m, C)
        end = segment.first
    return exact_moments(factors[:end], values[:end], own[:end], (m, C))


def deviations(factors: Sequence[Factor], values: Sequence[Scalar], segment: Segment) -> Vector:
    """(3,) the tool point at the nodes (N,) of a segment that is the whole chain, less the one at zero [m], world."""
    return _walked(factors, values, [0.0] * len(factors), _shifts(segment, segment.centre, False), ZERO, None)[1]


def _mixed_moments(
    segment: Segment, factors: Sequence[Factor], values: Sequence[Scalar], own: Sequence[Scalar], m: Vector, C: Matrix3
) -> tuple[Vector, Matrix3]:
    """Moments (3,) [m], (3, 3) [m²] in front of the segment from those behind it."""
    symbolic = any(isinstance(value, ca.SX) for value in (*values, *m))
    centre, same = _shifts(segment, segment.centre, symbolic), segment.width is segment.centre
    mean, d, wide = _walked(factors, values, own, centre, m, C if same else None)
    if wide is None:
        wide = _walked(factors, values, own, _shifts(segment, segment.width, symbolic), m, C)[2]
    assert wide is not None
    w = segment.centre.weights
    x, y, z = (_node_average(w, entry) for entry in d)
    d = (d[0] - x, d[1] - y, d[2] - z)
    mixed = _no_covariance()
    for a in range(3):
        for b in range(a, 3):
            mixed[a][b] = mixed[b][a] = _node_average(segment.width.weights, wide[a][b]) + _node_average(w, d[a] * d[b])
    return add(mean, (x, y, z)), mixed


def _shifts(segment: Segment, nodes: Nodes, symbolic: bool) -> list[_Shift | None]:
    """What the nodes (N,) of a segment add to each of its factors; None where no shared factor acts."""
    found: list[_Shift | None] = [None] * (segment.last - segment.first + 1)
    for index, loading in segment.loadings.items():
        size = loading @ nodes.points.T
        parts = size, np.sin(size), -2 * np.sin(size / 2) ** 2
        found[index - segment.first] = _Shift(*(ca.SX(ca.DM(x)) if symbolic else x for x in parts))
    return found


def _walked(
    factors: Sequence[Factor],
    values: Sequence[Scalar],
    own: Sequence[Scalar],
    shifts: Sequence[_Shift | None],
    m: Vector,
    C: Matrix3 | None,
) -> tuple[Vector, Vector, Matrix3 | None]:
    """Mean (3,) at z = 0, its deviation (3,) at the nodes and, unless left out, covariance (3, 3) at the nodes."""
    d = ZERO
    chain = zip(factors, values, own, shifts, strict=True)
    for factor, value, v, shift in reversed(list(chain)):
        k = factor.axis
        if factor.kind == "translate":
            m, d = _shifted(k, value, m), _shifted(k, shift.size, d) if shift else d
            C = C and _widened(k, v, C)
            continue
        if not (isinstance(v, float) and v == 0.0):
            C = C and _blurred(k, v, m if d is ZERO else add(m, d), C)
            m, d = _smoothed(k, v, m), d if d is ZERO else _smoothed(k, v, d)
        c, s = cos_sin(value)
        cz, sz = c, s
        if shift:
            d = add(d, _rotation_change(k, shift, add(m, d)))
            cz, sz = c + (c * shift.cosine_less_one - s * shift.sine), s + (s * shift.cosine_less_one + c * shift.sine)
        # d was bent by the shift already, and turns on like m; C turns by both at once.
        m, d, C = _turned(k, c, s, m), d if d is ZERO else _turned(k, c, s, d), C and _turned_covariance(k, cz, sz, C)
    return m, d, C


def _no_covariance() -> Matrix3:
    return [[0.0] * 3 for _ in range(3)]


def _shifted(k: int, t: Scalar, m: Vector) -> Vector:
    x = list(m)
    x[k] = x[k] + t
    return (x[0], x[1], x[2])


def _widened(k: int, v: Scalar, C: Matrix3) -> Matrix3:
    D = [list(row) for row in C]
    D[k][k] = D[k][k] + v
    return D


def _smoothed(k: int, v: Scalar, m: Vector) -> Vector:
    """The mean of a vector after a random rotation about axis k by an angle N(0, v)."""
    e1 = _exp(-v / 2)
    x = [e1 * entry for entry in m]
    x[k] = m[k]
    return (x[0], x[1], x[2])


def _blurred(k: int, v: Scalar, m: Vector, C: Matrix3) -> Matrix3:
    """The covariance of a vector with mean m after a random rotation about axis k by an angle N(0, v)."""
    i, j = (k + 1) % 3, (k + 2) % 3
    u = -_expm1(-v)
    vc, vs = u * u / 2, -_expm1(-2 * v) / 2
    e1, e2 = _exp(-v / 2), _exp(-2 * v)
    trace, difference = C[i][i] + C[j][j], e2 * (C[i][i] - C[j][j])
    mi2, mj2 = m[i] * m[i], m[j] * m[j]
    D = _no_covariance()
    D[i][i] = (trace + difference) / 2 + vc * mi2 + vs * mj2
    D[j][j] = (trace - difference) / 2 + vs * mi2 + vc * mj2
    D[i][j] = D[j][i] = e2 * C[i][j] + (vc - vs) * (m[i] * m[j])
    D[k][k] = C[k][k]
    D[k][i] = D[i][k] = e1 * C[k][i]
    D[k][j] = D[j][k] = e1 * C[k][j]
    return D


def _turned(k: int, c: Scalar, s: Scalar, m: Vector) -> Vector:
    """A vector after a certain rotation about axis k, by its cosine and sine."""
    if _is_identity(c, s):
        return m
    i, j = (k + 1) % 3, (k + 2) % 3
    x = list(m)
    x[i], x[j] = c * m[i] - s * m[j], s * m[i] + c * m[j]
    return (x[0], x[1], x[2])


def _turned_covariance(k: int, c: Scalar, s: Scalar, C: Matrix3) -> Matrix3:
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


def _rotation_change(k: int, shift: _Shift, p: Vector) -> Vector:
    """``(R − 1) p`` with the rotation R about axis k."""
    i, j = (k + 1) % 3, (k + 2) % 3
    x: list[Scalar] = [0.0, 0.0, 0.0]
    x[i] = shift.cosine_less_one * p[i] - shift.sine * p[j]
    x[j] = shift.sine * p[i] + shift.cosine_less_one * p[j]
    return (x[0], x[1], x[2])


def _node_average(weights: Array, x: Scalar) -> Scalar:
    """The average over nodes on the last axis; a number that does not depend on them is its own average."""
    if isinstance(x, ca.SX):
        return x if x.is_scalar() else ca.dot(ca.SX(ca.DM(weights)), x)
    if not isinstance(x, np.ndarray) or x.shape[-1] == 1:
        return x
    return (x @ weights)[..., None]


def _is_identity(c: Scalar, s: Scalar) -> bool:
    return isinstance(s, float) and s == 0.0 and isinstance(c, float) and c == 1.0


def _exp(x: Scalar) -> Scalar:
    return math.exp(x) if isinstance(x, float) else np.exp(x) if isinstance(x, np.ndarray) else ca.exp(x)


def _expm1(x: Scalar) -> Scalar:
    return math.expm1(x) if isinstance(x, float) else np.expm1(x) if isinstance(x, np.ndarray) else ca.expm1(x)


Complex = tuple[Scalar, Scalar]  # Real and imaginary part, so that symbols serve too


@dataclass(frozen=True)
class Plane:
    """The plane that a planar arm moves in."""

    e1: Vector  # e1, e2: (3,) orthonormal basis, world
    e2: Vector
    normal: Vector  # (3,) e1 × e2, world


def plane_of(robot: Robot, uncertain: Sequence[int] = ()) -> Plane | None:
    """The plane of motion; None where the joints, or factors with an error at ``uncertain``, turn about other axes."""
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
    """Exact mean (3,) [m] and covariance (3, 3) [m²] of the tool point, world frame. indices: (k,) factor that each
    source acts on; covariance: (k, k) Σ of the sources; plane: from :func:`plane_of` with the same ``indices``."""
    arrows = _chain_arrows(robot, reached, lengths, indices, plane)
    mean: list[Scalar] = [0.0, 0.0, 0.0]
    power: Scalar = 0.0
    pseudo: Complex = (0.0, 0.0)
    height: Scalar = 0.0
    lift: Complex = (0.0, 0.0)
    for m in arrows:
        half = math.exp(-float(m.of_angle @ covariance @ m.of_angle) / 2)
        arrow = half * m.length, half * float(m.of_length @ covariance @ m.of_angle)  # E[ℓ e^{iS}], see the module
        z = _product(arrow, m.direction)
        mean = [mean[0] + z[0], mean[1] + z[1], mean[2] + m.height * m.length]
        for n in arrows:
            conjugate = n.direction[0], -n.direction[1]
            hermitian = _product(_arrow_covariance(m, n, covariance, -1), _product(m.direction, conjugate))
            power = power + hermitian[0]
            plain = _product(_arrow_covariance(m, n, covariance, +1), _product(m.direction, n.direction))
            pseudo = _sum(pseudo, plain)
            height = height + m.height * n.height * float(m.of_length @ covariance @ n.of_length)
            lift = _sum(lift, _product(_height_covariance(m, n, covariance), n.direction))
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


def _arrow_covariance(m: _Arrow, n: _Arrow, S: np.ndarray, sign: int) -> Complex:
    """``Cov(ℓ_m e^{iS_m}, ℓ_n e^{± iS_n})`` (sign −1: with the conjugate, which makes it the Hermitian one)."""
    c = -sign * float(m.of_angle @ S @ n.of_angle)
    both = math.exp(-float(m.of_angle @ S @ m.of_angle + n.of_angle @ S @ n.of_angle) / 2)
    A: Complex = (m.length, float(m.of_length @ S @ m.of_angle))
    B: Complex = (n.length, sign * float(n.of_length @ S @ n.of_angle))
    alpha, beta = sign * float(m.of_length @ S @ n.of_angle), float(n.of_length @ S @ m.of_angle)
    AB = _product(A, B)
    # (A + iα)(B + iβ) − A B + Cov(ℓ_m, ℓ_n), formed without the cancellation
    extra = _sum(_product((0.0, alpha), B), _product(A, (0.0, beta)))
    extra = (extra[0] - alpha * beta + float(m.of_length @ S @ n.of_length), extra[1])
    grow, less = both * math.exp(c), both * math.expm1(c)
    return (less * AB[0] + grow * extra[0], less * AB[1] + grow * extra[1])


def _height_covariance(m: _Arrow, n: _Arrow, S: np.ndarray) -> Complex:
    """``Cov(height of m, ℓ_n e^{iS_n})``."""
    half = m.height * math.exp(-float(n.of_angle @ S @ n.of_angle) / 2)
    turn = float(m.of_length @ S @ n.of_angle)
    shift = float(m.of_length @ S @ n.of_length) - turn * float(n.of_length @ S @ n.of_angle)
    return (half * shift, half * turn * n.length)


def _product(u: Complex, v: Complex) -> Complex:
    """``u v``."""
    return (u[0] * v[0] - u[1] * v[1], u[0] * v[1] + u[1] * v[0])


def _sum(u: Complex, v: Complex) -> Complex:
    """``u + v``."""
    return (u[0] + v[0], u[1] + v[1])


def _as_vector(array: np.ndarray) -> Vector:
    """(3,) plain floats."""
    return (float(array[0]), float(array[1]), float(array[2]))
