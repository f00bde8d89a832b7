"""Mean and covariance of the tool point for errors that share factors, from nodes for the factors.

Given the factors z of `SharedFactors` the errors are independent with known means ``L z``: the walk of
:mod:`posture_opt.uncertainty.moments.exact_moments` gives mean and covariance of the tool point, and by the law of
total covariance ``C = E C(z) + Cov m(z)``, both positive semidefinite with nodes of positive weight. The mean at a
node is carried as its deviation d from the mean at z = 0: ``R(α) (m + d) − m`` with ``cos α − 1`` formed as ``−2 sin²
α/2``, so that ``Σ w d dᵀ`` keeps its digits however small the errors are.

Behind the outermost source of a factor the chain does not know of it, and before the innermost one only the mixture
counts: nodes cost their number of walks along this `Segment` alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from posture_opt.model.chain import ZERO, Scalar, Vector, add, cos_sin
from posture_opt.numerics import Array
from posture_opt.robot.robot import Factor
from posture_opt.uncertainty.moments.exact_moments import (
    Matrix3,
    blurred,
    certain,
    exact_moments,
    no_covariance,
    shifted,
    smoothed,
    turned,
    turned_covariance,
    widened,
)
from posture_opt.uncertainty.moments.gaussian_rules import Nodes


@dataclass(frozen=True, eq=False)
class Segment:
    """The part of a chain along which r shared factors act, and the nodes for them.

    Args:
        first, last: of the factors of the chain, both included.
        loadings: place in the chain -> (r,) or (..., r) standard deviation there by each shared factor [rad or m].
        centre: nodes at which the mean is taken, whose covariance counts.
        width: nodes at which the covariance is taken, whose mean counts; the same, or fewer.
    """

    first: int
    last: int
    loadings: Mapping[int, Array]
    centre: Nodes
    width: Nodes


def conditional_moments(
    factors: Sequence[Factor], values: Sequence[Scalar], own: Sequence[Scalar], segments: Sequence[Segment]
) -> tuple[Vector, Matrix3]:
    """Mean (3,) [m] and covariance (3, 3) [m²] of the tool point in the world.

    Args:
        factors: the chain from the base to the tool.
        values: mean of each factor [rad or m]: numbers, arrays (..., 1) or CasADi expressions.
        own: variance of each factor given the shared ones [rad² or m²]; numbers or arrays (..., 1).
        segments: apart from each other, in any order.
    """
    m, C, end = ZERO, no_covariance(), len(factors)
    for segment in sorted(segments, key=lambda segment: -segment.last):
        behind, within = slice(segment.last + 1, end), slice(segment.first, segment.last + 1)
        m, C = exact_moments(factors[behind], values[behind], own[behind], (m, C))
        m, C = _mixed_moments(segment, factors[within], values[within], own[within], m, C)
        end = segment.first
    return exact_moments(factors[:end], values[:end], own[:end], (m, C))


def deviations(factors: Sequence[Factor], values: Sequence[Scalar], segment: Segment) -> Vector:
    """(3,) the tool point at the nodes (N,) of a segment that is the whole chain, less the one at zero [m], world."""
    return _conditional_walk(
        factors, values, [0.0] * len(factors), _node_shifts(segment, segment.centre, False), ZERO, None
    )[1]


def _mixed_moments(
    segment: Segment, factors: Sequence[Factor], values: Sequence[Scalar], own: Sequence[Scalar], m: Vector, C: Matrix3
) -> tuple[Vector, Matrix3]:
    """Moments in front of the segment from those behind it.

    ``m`` (3,) [m] and ``C`` (3, 3) [m²] are of the point behind the segment, in the frame there.
    """
    symbolic = any(isinstance(value, ca.SX) for value in (*values, *m))
    same = segment.width is segment.centre
    mean, d, wide = _conditional_walk(
        factors, values, own, _node_shifts(segment, segment.centre, symbolic), m, C if same else None
    )
    if wide is None:
        wide = _conditional_walk(factors, values, own, _node_shifts(segment, segment.width, symbolic), m, C)[2]
    assert wide is not None
    w = segment.centre.weights
    offset = [_node_average(w, x) for x in d]
    d = (d[0] - offset[0], d[1] - offset[1], d[2] - offset[2])
    moved = add(mean, (offset[0], offset[1], offset[2]))
    mixed = no_covariance()
    for a in range(3):
        for b in range(a, 3):
            mixed[a][b] = mixed[b][a] = _node_average(segment.width.weights, wide[a][b]) + _node_average(w, d[a] * d[b])
    return moved, mixed


@dataclass(frozen=True)
class _Shift:
    """What the nodes add to one factor: ``size`` [rad or m], its sine and its cosine less one."""

    size: Scalar
    sine: Scalar
    cosine_less_one: Scalar


def _node_shifts(segment: Segment, nodes: Nodes, symbolic: bool) -> list[_Shift | None]:
    """What the nodes (N,) of a segment add to each of its factors; None where no shared factor acts."""
    found: list[_Shift | None] = [None] * (segment.last - segment.first + 1)
    for index, loading in segment.loadings.items():
        size = loading @ nodes.points.T
        parts = size, np.sin(size), -2 * np.sin(size / 2) ** 2
        found[index - segment.first] = _Shift(*(ca.SX(ca.DM(x)) if symbolic else x for x in parts))
    return found


def _conditional_walk(
    factors: Sequence[Factor],
    values: Sequence[Scalar],
    own: Sequence[Scalar],
    shifts: Sequence[_Shift | None],
    m: Vector,
    C: Matrix3 | None,
) -> tuple[Vector, Vector, Matrix3 | None]:
    """Mean (3,) at z = 0, deviation (3,) of the mean at the nodes from it and, unless left out, covariance (3, 3) at
    the nodes.
    """
    d = ZERO
    chain = zip(factors, values, own, shifts, strict=True)
    for factor, value, v, shift in reversed(list(chain)):
        k = factor.axis
        if factor.kind == "translate":
            m, d = shifted(k, value, m), shifted(k, shift.size, d) if shift else d
            C = C and widened(k, v, C)
            continue
        if not certain(v):
            C = C and blurred(k, v, add(m, d), C)
            m, d = smoothed(k, v, m), smoothed(k, v, d)
        c, s = cos_sin(value)
        cz, sz = c, s
        if shift:
            d = add(d, _rotation_change(k, shift, add(m, d)))
            cz, sz = c + (c * shift.cosine_less_one - s * shift.sine), s + (s * shift.cosine_less_one + c * shift.sine)
        # d was bent by the shift already, and turns on like m; C turns by both at once.
        m, d, C = turned(k, c, s, m), turned(k, c, s, d), C and turned_covariance(k, cz, sz, C)
    return m, d, C


def _rotation_change(k: int, shift: _Shift, p: Vector) -> Vector:
    """``(R − 1) p`` with the rotation R about axis k."""
    i, j = (k + 1) % 3, (k + 2) % 3
    x: list[Scalar] = [0.0, 0.0, 0.0]
    x[i] = shift.cosine_less_one * p[i] - shift.sine * p[j]
    x[j] = shift.sine * p[i] + shift.cosine_less_one * p[j]
    return (x[0], x[1], x[2])


def _node_average(weights: Array, x: Scalar) -> Scalar:
    """The average over the nodes, which are on the last axis; a number that does not depend on them is its own
    average.
    """
    if isinstance(x, ca.SX):
        return x if x.is_scalar() else ca.dot(ca.SX(ca.DM(weights)), x)
    if not isinstance(x, np.ndarray) or x.shape[-1] == 1:
        return x
    return (x @ weights)[..., None]
