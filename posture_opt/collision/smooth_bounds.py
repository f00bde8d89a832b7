"""Smooth lower bounds of the distance of a capsule to a solid, as expressions for a nonlinear program.

The least squared distance of a segment ``a + s u`` to a convex solid is that of a convex function of the share s, but
its gradient jumps where the segment is parallel to a face or to another segment. So ``ε s (s − 1) ≤ 0`` is added before
the least is taken: the sum has one minimiser, its least value is differentiable (Danskin 1967), never above the true
one, and below it by ``ε/4`` at most for each share. `BOUND_SLACK_M` says what that may cost of the distance.

Minimisers are found without a derivative. With the derivative ``g`` and the second derivative ``h`` of the function
along the segment, ``F − g²/2h`` is the least value, as g is zero there; and its first and second derivatives in the
joint values are those of the least value too, with far fewer operations than through the minimiser.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

BOUND_SLACK_M = 5e-4
"""How much below the true distance the bound of one pair may be [m], near contact."""
SOFT_MINIMUM_WIDTH_M = 1e-3
"""Width of the soft minimum [m]: two equal distances count as half of it less."""
_LINEAR_BELOW_M = 5e-3
"""Distance between centre lines [m] below which a line takes the place of the root."""
_NEWTON_STEPS = 7
"""Steps of Newton's method for a cylinder."""
_SETTLED_SCALE = 2.0**40
"""Shares are rounded to 2^−40, which has no derivative and no effect."""
_MIN_DIVISOR = 1e-12
"""In place of zero in a division."""
_MIN_AXIS_SQUARE = 1e-24
"""Added below a root [m²]: keeps it away from zero on the axis of a cylinder."""


def segment_bound(
    start: ca.SX, along: ca.SX, length: float, other: ca.SX, other_along: ca.SX, other_length: float, radius: float
) -> ca.SX:
    """Lower bound of the distance of two capsules [m], an expression that is differentiable everywhere.

    Args:
        start, other: (3,) where the segments start [m]; along, other_along: (3,) their ends less that [m].
        length, other_length: of the segments [m].
        radius: sum of the radii [m].
    """
    eps = 2 * BOUND_SLACK_M * 2 * radius
    w = start - other
    A, C = length**2 + eps, other_length**2 + eps
    b, d, e = (_settled(ca.dot(*pair)) for pair in ((along, other_along), (along, w), (other_along, w)))
    s = _clipped_share(((eps / 2 - d) * C + b * (e + eps / 2)) / (A * C - b * b))
    t = _clipped_share((b * s + e + eps / 2) / C)
    s = _settled(_clipped_share((b * t + eps / 2 - d) / A))
    t = _settled(t)
    between = w + s * along - t * other_along
    g, h = ca.dot(between, along) + eps * (s - 0.5), -ca.dot(between, other_along) + eps * (t - 0.5)
    free, other_free = _is_inside(s), _is_inside(t)
    both = free * other_free
    joint = both / (A * C - b * b)
    corner = g * g * (joint * C + (free - both) / A) + h * h * (joint * A + (other_free - both) / C)
    squared = ca.sumsqr(between) + eps * (s * (s - 1) + t * (t - 1)) - corner - 2 * joint * b * g * h
    return _bounded_root(squared) - radius


def point_bound(start: ca.SX, along: ca.SX, length: float, point: Sequence[float], radius: float) -> ca.SX:
    """Distance of a capsule to a sphere [m], exact.

    Args:
        start, along: (3,) where the segment starts and the vector to its end [m].
        length: of the segment [m].
        point: (3,) middle of the sphere [m].
        radius: sum of both radii [m].
    """
    w, size = start - ca.vertcat(*point), max(length**2, _MIN_DIVISOR)
    s = _settled(_clipped_share(-ca.dot(along, w) / size))
    nearest = w + s * along
    return _bounded_root(_least_value(ca.sumsqr(nearest), s, ca.dot(nearest, along), ca.SX(size))) - radius


def half_space_bounds(start: ca.SX, along: ca.SX, normal: Sequence[float], offset: float, radius: float) -> list[ca.SX]:
    """Heights of both ends of a capsule over the plane ``normal · x = offset`` [m]; one where they are the same.

    Args:
        start, along: (3,) where the segment starts and the vector to its end [m].
        normal: (3,) unit vector out of the solid.
        offset, radius: [m].
    """
    n = ca.DM(list(normal))
    ends = [start, start + along] if not along.is_zero() else [start]
    return [ca.dot(n, end) - offset - radius for end in ends]


def box_bound(start: ca.SX, along: ca.SX, half: Sequence[float], radius: float) -> ca.SX:
    """Lower bound of the distance of a capsule to a box about the origin [m].

    The derivative along the segment is piecewise linear, with a corner where the segment crosses the plane of a face.

    Args:
        start, along: (3,) where the segment starts and the vector to its end [m], frame of the box.
        half: (3,) half sides [m].
        radius: of the capsule [m].
    """
    eps = 4 * BOUND_SLACK_M * 2 * radius
    h = ca.vertcat(*half)

    def excess(s: ca.SX) -> ca.SX:
        point = start + s * along
        return point - ca.fmin(ca.fmax(point, -h), h)

    def slope(s: ca.SX) -> ca.SX:
        return ca.dot(excess(s), along) + eps * (s - 0.5)

    corners = [ca.SX(0), ca.SX(1)]
    corners += [
        _clipped_share(
            (side * half[k] - start[k]) / ca.if_else(ca.fabs(along[k]) > _MIN_DIVISOR, along[k], _MIN_DIVISOR)
        )
        for k in range(3)
        for side in (-1, 1)
    ]
    s = _settled(_crossing_share(corners, [slope(corner) for corner in corners]))
    outside = ca.fabs(start + s * along) > h
    squared = ca.sumsqr(excess(s)) + eps * s * (s - 1)
    return _bounded_root(_least_value(squared, s, slope(s), ca.dot(outside, along**2) + eps)) - radius


def cylinder_bound(start: ca.SX, along: ca.SX, size: float, half: float, radius: float) -> ca.SX:
    """Lower bound of the distance of a capsule to a solid cylinder about z [m].

    The corners of the derivative lie where the segment enters or leaves the infinite cylinder and the slab; Newton's
    method goes on from the secant between two of them. What it may not have reached is taken off.

    Args:
        start, along: (3,) where the segment starts and the vector to its end [m], frame of the cylinder.
        size: radius of the cylinder [m].
        half: half its length [m].
        radius: of the capsule [m].
    """
    eps = 4 * BOUND_SLACK_M * 2 * radius
    flat = along[0] ** 2 + along[1] ** 2

    def parts(s: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        x, y, z = ca.vertsplit(start + s * along)
        rho = ca.sqrt(x * x + y * y + _MIN_AXIS_SQUARE)
        over = ca.fmax(rho - size, 0)
        high = z - ca.fmin(ca.fmax(z, -half), half)
        inward = (x * along[0] + y * along[1]) / rho
        slope = over * inward + high * along[2] + eps * (s - 0.5)
        beyond = (over > 0) * (inward**2 + over / rho * (flat - inward**2))
        return over, high, slope, beyond + (high != 0) * along[2] ** 2 + eps

    middle = -(start[0] * along[0] + start[1] * along[1]) / (flat + _MIN_DIVISOR)
    reach = (start[0] + middle * along[0]) ** 2 + (start[1] + middle * along[1]) ** 2
    wide = ca.sqrt(ca.fmax(size**2 - reach, 0) / (flat + _MIN_DIVISOR))
    rise = ca.if_else(ca.fabs(along[2]) > _MIN_DIVISOR, along[2], _MIN_DIVISOR)
    shares = [middle - wide, middle + wide, (half - start[2]) / rise, (-half - start[2]) / rise]
    corners = [ca.SX(0), ca.SX(1), *map(_clipped_share, shares)]
    slopes = [parts(corner)[2] for corner in corners]
    low, high = _slope_bracket(corners, slopes)
    s = _crossing_share(corners, slopes)
    for _ in range(_NEWTON_STEPS):
        _, _, slope, curvature = parts(s)
        low, high = ca.if_else(slope < 0, s, low), ca.if_else(slope > 0, s, high)
        newton = s - slope / curvature
        s = ca.if_else((newton < low) + (newton > high), (low + high) / 2, newton)
    s = _settled(s)
    over, above, slope, curvature = parts(s)
    squared = over**2 + above**2 + eps * s * (s - 1) - _settled_up(_is_inside(s) * slope**2 * (1 / eps - 1 / curvature))
    return _bounded_root(_least_value(squared, s, slope, curvature)) - radius


def soft_minimum(distances: Sequence[ca.SX]) -> ca.SX:
    """A smooth lower bound of the least of k distances [m], below it by ``½ SOFT_MINIMUM_WIDTH_M ⌈log₂ k⌉`` at most.

    ``min(a, b) ≥ (a + b − √((a − b)² + δ²))/2``, taken pair by pair, with δ = `SOFT_MINIMUM_WIDTH_M`.
    """
    level = list(distances)
    while len(level) > 1:
        paired = [_soft_minimum_of_two(level[k], level[k + 1]) for k in range(0, len(level) - 1, 2)]
        level = paired + level[len(level) - len(level) % 2 :]
    return level[0]


def _soft_minimum_of_two(a: ca.SX, b: ca.SX) -> ca.SX:
    """``(a + b − √((a − b)² + δ²))/2`` [m]."""
    return (a + b - ca.sqrt((a - b) ** 2 + SOFT_MINIMUM_WIDTH_M**2)) / 2


def _bounded_root(squared: ca.SX) -> ca.SX:
    """The square root [m] of a square [m²], below `_LINEAR_BELOW_M` its tangent: a slope leads out of a collision."""
    return ca.sqrt(ca.fmax(squared, _LINEAR_BELOW_M**2)) + ca.fmin(squared - _LINEAR_BELOW_M**2, 0) / (
        2 * _LINEAR_BELOW_M
    )


def _clipped_share(share: ca.SX) -> ca.SX:
    """A share of a segment between 0 and 1."""
    return ca.fmin(ca.fmax(share, 0), 1)


def _settled(value: ca.SX) -> ca.SX:
    """The same number, rounded down to 2^−40, without a derivative."""
    return ca.floor(value * _SETTLED_SCALE) / _SETTLED_SCALE


def _settled_up(value: ca.SX) -> ca.SX:
    """The same number, rounded up to 2^−40, without a derivative."""
    return -ca.floor(-value * _SETTLED_SCALE) / _SETTLED_SCALE


def _is_inside(share: ca.SX) -> ca.SX:
    """1 where a share is neither 0 nor 1, else 0."""
    return (share > 0) * (share < 1)


def _least_value(squared: ca.SX, share: ca.SX, slope: ca.SX, curvature: ca.SX) -> ca.SX:
    """The least value of a function with this value, half derivative and half second derivative at its minimiser.

    ``F − g²/h``: g is zero there, but its derivative in the joint values is not.
    """
    return squared - _is_inside(share) / _settled(curvature) * slope**2


def _slope_bracket(corners: Sequence[ca.SX], slopes: Sequence[ca.SX]) -> tuple[ca.SX, ca.SX]:
    """The last corner with a slope below zero and the first one with a slope above, of slopes that only rise.

    Args:
        corners: shares of the segment, 0 and 1 first; slopes: at each of them.
    """
    low, high = ca.SX(0), ca.SX(1)
    for corner, slope in zip(corners, slopes, strict=True):
        low = ca.fmax(low, ca.if_else(slope <= 0, corner, 0))
        high = ca.fmin(high, ca.if_else(slope >= 0, corner, 1))
    return low, high


def _crossing_share(corners: Sequence[ca.SX], slopes: Sequence[ca.SX]) -> ca.SX:
    """Where the slope crosses zero, were it linear between corners; an end of the segment where it nowhere does."""
    low, high = _slope_bracket(corners, slopes)
    below, above = ca.SX(-ca.inf), ca.SX(ca.inf)
    for slope in slopes:
        below = ca.fmax(below, ca.if_else(slope <= 0, slope, -ca.inf))
        above = ca.fmin(above, ca.if_else(slope >= 0, slope, ca.inf))
    share = low - below * (high - low) / ca.fmax(above - below, _MIN_DIVISOR)
    return ca.if_else(slopes[0] >= 0, 0, ca.if_else(slopes[1] <= 0, 1, share))
