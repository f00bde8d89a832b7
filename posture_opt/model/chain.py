"""The forward model of a chain of elementary transforms, for numbers, NumPy arrays and CasADi symbols alike.

One walk from the base to the tool gives the pose and, for every factor, the axis and the origin that all
derivatives follow from. For factor i before factor j in the chain, with axis ``a``, origin ``o`` and tool point ``x``:

- rotation:     ``∂x/∂i = a_i × (x − o_i)``,  translation: ``∂x/∂i = a_i``
- ``∂²x/∂i∂j = a_i × ∂x/∂j`` where i rotates, else zero (what lies nearer to the base turns the rest)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor

Scalar = Any
"""A float, an array of shape (N,), or a CasADi expression: whatever the walk is fed with."""
Values: TypeAlias = "ArrayLike | Sequence[Scalar] | ca.SX | ca.MX"
"""A vector of numbers, an array of several, or a CasADi expression."""
Stacked: TypeAlias = "Array | ca.SX"
"""What comes of values: an array of numbers, or an expression where one of them is."""
Vector = tuple[Scalar, Scalar, Scalar]
"""Three scalars: world coordinates [m], or a direction."""
ZERO: Vector = (0.0, 0.0, 0.0)
"""The vector that is exactly zero; tested by identity, so that symbols that never move are left out of a graph."""


@dataclass(frozen=True)
class Screw:
    """Where one factor acts.

    Args:
        rotates: whether it turns; else it shifts.
        axis: (3,) unit vector, world.
        origin: (3,) a point on the axis [m], world.
    """

    rotates: bool
    axis: Vector
    origin: Vector


@dataclass(frozen=True)
class Walk:
    """The pose of the tool in the world and the screw of every factor.

    Args:
        columns: (3, 3) the three columns of ``R_world_tool``.
        position: (3,) the tool point [m], world.
        screws: one a factor, in the order of the chain.
    """

    columns: tuple[Vector, Vector, Vector]
    position: Vector
    screws: tuple[Screw, ...]


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
    """The value of each factor, ``nominal + p[parameter] + q[joint]`` [rad or m].

    Args:
        factors: of the chain, or of a part of it.
        q: (n,) joint variables [rad or m].
        p: parameter -> deviation [rad or m]; parameters that are missing deviate by nothing.
    """
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
    """Forward kinematics: the product of all factors, from the base to the tool; on from where ``begin`` ends.

    ``screws`` are those of these factors alone.

    Args:
        factors: from the base to the tool.
        values: of each factor [rad or m], see `factor_values`.
        begin: an earlier walk to go on from; the world's frame if left out.

    Example:
        >>> from posture_opt.robot.robot import Factor
        >>> reached = walk([Factor("rotate", 2), Factor("translate", 0)], [math.pi / 2, 0.5])
        >>> reached.position
        (0.0, 0.5, 0.0)
    """
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
    """``a b``; a symbol times an exact 0 or 1 is what CasADi makes of it, without a call that costs 20 microseconds."""
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
    """A nested tuple of scalars as one array: SX of the same shape, or NumPy with the batch axis first.

    (r,) scalars become (r,) or (N, r), rows of c scalars (r, c) or (N, r, c); in CasADi a vector is a column (r, 1).
    """
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
    """The ``size`` entries of a vector: of an SX, a sequence, or an array whose last axis has that size.

    Args:
        values: (size,) or (..., size).
        size: how many entries are wanted.
        what: its name in the error.

    Raises:
        ValueError: another number of entries.
    """
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
    """The walk with its tool shifted and turned behind the chain; screws stay those of the chain.

    Args:
        reached: the walk.
        shift: (3,) of the tool point [m], world.
        turn: (3,) small rotation of the tool [rad], world axes; to second order.
    """
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
    """Angular velocity (3,) of the tool per unit of factor i [rad/rad], world frame; zero where it shifts."""
    screw = walk.screws[i]
    return screw.axis if screw.rotates else ZERO


def _is_symbolic(x: Scalar) -> bool:
    """Whether this is an expression of CasADi."""
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
