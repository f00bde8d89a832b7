"""The forward model of a chain of elementary transforms, for numbers, NumPy arrays and CasADi symbols alike.

One walk from the base to the tool gives the pose and, for every factor, the axis and the origin that all
derivatives follow from. For factor i before factor j in the chain, with axis ``a``, origin ``o`` and tool point ``x``:

- rotation:     ``∂x/∂i = a_i × (x − o_i)``,  translation: ``∂x/∂i = a_i``
- ``∂²x/∂i∂j = a_i × ∂x/∂j`` where i rotates, else zero (what lies nearer to the base turns the rest)
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor, Robot

Scalar = Any  # A float, an array of shape (N,), or a CasADi expression: whatever the walk is fed with
# A vector of numbers, an array of several, or a CasADi expression
Values: TypeAlias = "ArrayLike | Sequence[Scalar] | ca.SX | ca.MX"
Stacked: TypeAlias = "Array | ca.SX"  # What comes of values: an array of numbers, or an expression where one of them is
Vector = tuple[Scalar, Scalar, Scalar]  # Three scalars: world coordinates [m], or a direction
# The vector that is exactly zero; tested by identity, so that symbols that never move are left out of a graph
ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Screw:
    """Where one factor acts."""

    rotates: bool  # whether it turns; else it shifts
    axis: Vector  # (3,) unit vector, world
    origin: Vector  # (3,) a point on the axis [m], world


@dataclass(frozen=True)
class Walk:
    """The pose of the tool in the world and the screw of every factor."""

    columns: tuple[Vector, Vector, Vector]  # (3, 3) the three columns of R_world_tool
    position: Vector  # (3,) the tool point [m], world
    screws: tuple[Screw, ...]  # one a factor, in the order of the chain


def cos_sin(angle: Scalar) -> tuple[Scalar, Scalar]:
    """Cosine and sine; exact zeros for numeric quarter turns, so that planar arms stay planar in the symbols."""
    if isinstance(angle, int | float):
        c, s = math.cos(angle), math.sin(angle)
        return (0.0 if abs(c) < 1e-15 else c), (0.0 if abs(s) < 1e-15 else s)
    if isinstance(angle, np.ndarray):
        return np.cos(angle), np.sin(angle)
    return ca.cos(angle), ca.sin(angle)


def factor_values(
    factors: Sequence[Factor], q: Sequence[Scalar], p: Mapping[str, Scalar] | None = None
) -> list[Scalar]:
    """``nominal + p[parameter] + q[joint]`` [rad or m] of each factor."""
    p = p or {}
    values: list[Scalar] = []
    for factor in factors:
        value: Scalar = factor.nominal
        if factor.parameter in p:
            value = value + p[factor.parameter]
        if factor.joint is not None:
            value = value + q[factor.joint]
        values.append(value)
    return values


def walk(factors: Sequence[Factor], values: Sequence[Scalar], begin: Walk | None = None) -> Walk:
    """Forward kinematics: the product of all factors, values [rad or m], from the base to the tool; on from ``begin``.
    ``screws`` are those of these factors alone."""
    columns: list[Vector] = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)] if begin is None else [*begin.columns]
    origin: Vector = (0.0, 0.0, 0.0) if begin is None else begin.position
    symbolic = any(isinstance(x, ca.SX) for x in (*values, *origin, *(x for column in columns for x in column)))
    screws = []
    for factor, value in zip(factors, values, strict=True):
        axis = columns[factor.axis]
        screws.append(Screw(factor.kind == "rotate", axis, origin))
        if factor.kind == "translate":
            origin = add(origin, scale(value, axis))
        else:
            i, j = (factor.axis + 1) % 3, (factor.axis + 2) % 3
            c, s = cos_sin(value)
            ci, cj = columns[i], columns[j]
            if symbolic:
                columns[i], columns[j] = add(scale(c, ci), scale(s, cj)), add(scale(c, cj), scale(-s, ci))
            else:  # the same, without looking at the type of each number
                columns[i] = (c * ci[0] + s * cj[0], c * ci[1] + s * cj[1], c * ci[2] + s * cj[2])
                columns[j] = (c * cj[0] - s * ci[0], c * cj[1] - s * ci[1], c * cj[2] - s * ci[2])
    return Walk((columns[0], columns[1], columns[2]), origin, tuple(screws))


def add(u: Vector, v: Vector) -> Vector:
    """``u + v``."""
    return (_sum(u[0], v[0]), _sum(u[1], v[1]), _sum(u[2], v[2]))


def subtract(u: Vector, v: Vector) -> Vector:
    """``u − v``."""
    return (u[0] - v[0], u[1] - v[1], u[2] - v[2])


def scale(factor: Scalar, v: Vector) -> Vector:
    """``factor v``."""
    return (_product(factor, v[0]), _product(factor, v[1]), _product(factor, v[2]))


def _product(a: Scalar, b: Scalar) -> Scalar:
    """``a b``; a symbol times an exact 0 or 1 without CasADi's call, which costs 20 microseconds."""
    if type(b) is float and type(a) is ca.SX:
        a, b = b, a
    if type(a) is float and type(b) is ca.SX and a in (0.0, 1.0):
        return b if a else 0.0
    return a * b


def _sum(a: Scalar, b: Scalar) -> Scalar:
    """``a + b``, a symbol and an exact zero as `_product` has it."""
    if type(b) is float and type(a) is ca.SX:
        a, b = b, a
    return b if type(a) is float and type(b) is ca.SX and a == 0.0 else a + b


def cross(u: Vector, v: Vector) -> Vector:
    """``u × v``."""
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


def dot(u: Sequence[Scalar], v: Sequence[Scalar]) -> Scalar:
    """``u · v``."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def stack(rows: Sequence[Sequence[Scalar]] | Sequence[Scalar]) -> Stacked:
    """Scalars as one array, (r,) or rows (r, c): SX of that shape, or NumPy with the batch axis first; CasADi vectors
    are (r, 1)."""
    nested = [list(row) if isinstance(row, list | tuple) else [row] for row in rows]
    flat = [entry for row in nested for entry in row]
    if any(isinstance(entry, ca.SX) for entry in flat):
        symbols: Stacked = ca.vertcat(*(ca.horzcat(*row) for row in nested))
        return symbols
    batch = np.broadcast_arrays(*(np.asarray(entry, dtype=float) for entry in flat))
    array = np.stack(batch, axis=-1)
    vector = not isinstance(rows[0], list | tuple)
    return array if vector else array.reshape(*array.shape[:-1], len(nested), len(nested[0]))


def split(values: Values, size: int, what: str) -> Sequence[Scalar]:
    """The ``size`` entries of an SX, a sequence, or an array (..., size); ValueError of ``what`` for another number."""
    if isinstance(values, ca.SX | ca.MX | ca.DM):
        entries: Sequence[Scalar] = ca.vertsplit(ca.vec(values))
        if isinstance(values, ca.DM):
            entries = [float(entry) for entry in entries]
    elif isinstance(values, list | tuple) and any(isinstance(v, ca.SX | ca.MX) for v in values):
        entries = values
    else:
        array = np.asarray(values, dtype=float)
        entries = [float(v) for v in array] if array.ndim == 1 else [array[..., k] for k in range(array.shape[-1])]
    if len(entries) != size:
        raise ValueError(f"{what}: {len(entries)} values given, {size} expected")
    return entries


def displaced(reached: Walk, shift: Vector, turn: Vector) -> Walk:
    """The walk with its tool shifted (3,) [m] and turned (3,) [rad], world, behind the chain, to second order in the
    turn."""
    if shift is ZERO and turn is ZERO:
        return reached
    a, b, c = reached.columns
    if turn is not ZERO:
        a, b, c = _turned_column(turn, a), _turned_column(turn, b), _turned_column(turn, c)
    return Walk((a, b, c), add(reached.position, shift), reached.screws)


def _turned_column(turn: Vector, column: Vector) -> Vector:
    """A column of a rotation after a small turn, to second order: ``c + ω × c + ½ ω × (ω × c)``."""
    first = cross(turn, column)
    return add(add(column, first), scale(0.5, cross(turn, first)))


def position_column(walk: Walk, i: int) -> Vector:
    """``∂x/∂i`` (3,) [m/rad or m/m], world frame: ``a_i × (x − o_i)`` where factor i rotates, else ``a_i``."""
    screw = walk.screws[i]
    return cross(screw.axis, subtract(walk.position, screw.origin)) if screw.rotates else screw.axis


def rotation_column(walk: Walk, i: int) -> Vector:
    """Angular velocity (3,) of the tool per unit of factor i [rad/rad], world frame; zero of a shift."""
    screw = walk.screws[i]
    return screw.axis if screw.rotates else ZERO


def _is_symbolic(x: Scalar) -> bool:
    return isinstance(x, ca.SX | ca.MX)


def sin(x: Scalar) -> Scalar:
    """Sine of numbers, arrays and CasADi expressions alike [rad]."""
    return ca.sin(x) if _is_symbolic(x) else np.sin(x)


def cos(x: Scalar) -> Scalar:
    """Cosine of numbers, arrays and CasADi expressions alike [rad]."""
    return ca.cos(x) if _is_symbolic(x) else np.cos(x)


def exp(x: Scalar) -> Scalar:
    """Exponential function of numbers, arrays and CasADi expressions alike."""
    return ca.exp(x) if _is_symbolic(x) else np.exp(x)


def magnitude(x: Scalar) -> Scalar:
    """``|x|``."""
    return ca.fabs(x) if _is_symbolic(x) else np.abs(x)


def nearest_integer(x: Scalar) -> Scalar:
    """``floor(x + 1/2)``: halves are rounded up, unlike NumPy's ``round``; its derivative is zero."""
    return ca.floor(x + 0.5) if _is_symbolic(x) else np.floor(np.asarray(x) + 0.5)


def at_least(x: Scalar, bound: float) -> Scalar:
    """1 where ``x >= bound``, else 0."""
    return ca.SX(x >= bound) if _is_symbolic(x) else np.asarray(np.asarray(x) >= bound, dtype=float)


def fixed_pose(factors: Iterable[Factor]) -> Array:
    """(4, 4) the product of factors at the joint value zero, lengths in [m]."""
    still = [Factor(f.kind, f.axis, f.nominal) for f in factors]
    reached = walk(still, factor_values(still, ()))
    (a, b, c), x = reached.columns, reached.position
    rows = [(a[k], b[k], c[k], x[k]) for k in range(3)]
    return np.asarray(stack([*rows, (0.0, 0.0, 0.0, 1.0)]), dtype=float)


def stretched(robot: Robot) -> tuple[Array, float]:
    """(3,) the origin of the first joint [m], world, and a distance [m] from it that the tool point never exceeds. The
    distance is the sum of all lengths behind the first joint, slides at their longest: the triangle inequality."""
    first = robot.driven[0]
    reached = walk(robot.factors, factor_values(robot.factors, [0.0] * robot.n))
    lengths = sum(abs(factor.nominal) for factor in robot.factors[first:] if factor.kind == "translate")
    slides = sum(max(abs(j.lower), abs(j.upper)) for j in robot.joints if j.type == "prismatic")
    return np.array(reached.screws[first].origin, dtype=float), float(lengths + slides)


@dataclass(frozen=True)
class Shell:
    """Two spheres about the origin of the first joint: the tool point stays between them."""

    centre: Array  # (3,) [m], world
    least: float  # least, most: their radii [m]
    most: float

    @classmethod
    def of(cls, robot: Robot) -> Shell:
        """The bounds of an arm by the triangle inequality, joint by joint from the tool to the base. The origins of
        neighbouring joints keep their distance ℓ as joints turn, so that a point that stays between a and b from one of
        them stays between ``max(ℓ − b, a − ℓ, 0)`` and ``ℓ + b`` from the next; a slide makes ℓ longer or shorter by
        its stroke. Joint limits and what bodies are in the way only make the reach smaller."""
        reached = walk(robot.factors, factor_values(robot.factors, [0.0] * robot.n))
        origins = [np.array(reached.screws[index].origin, dtype=float) for index in robot.driven]
        least, most, beyond = 0.0, 0.0, np.array(reached.position, dtype=float)
        for joint, origin in zip(reversed(robot.joints), reversed(origins), strict=True):
            length, stroke = float(np.linalg.norm(beyond - origin)), 0.0
            if joint.type == "prismatic":
                stroke = max(abs(joint.lower), abs(joint.upper))
            least, most = max(0.0, length - stroke - most, least - length - stroke), most + length + stroke
            beyond = origin
        return cls(origins[0], least, most)

    def misses(self, lower: Array, upper: Array, slack: float) -> bool:
        """Whether no point of the box (3,), (3,) [m], world, lies between the spheres, or within ``slack`` [m]."""
        nearest = np.linalg.norm(np.clip(self.centre, lower, upper) - self.centre)
        farthest = np.linalg.norm(np.maximum(np.abs(lower - self.centre), np.abs(upper - self.centre)))
        return bool(nearest > self.most + slack or farthest < self.least - slack)
