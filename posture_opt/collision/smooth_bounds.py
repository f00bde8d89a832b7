"""Smooth lower bounds of the distance of a capsule to a solid, as expressions for a nonlinear program."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

BOUND_SLACK_M = 5e-4
"""How much below the true distance the bound of one pair may be [m], near contact."""
SOFT_MINIMUM_WIDTH_M = 1e-3
"""Width of the soft minimum [m]: two equal distances count as half of it less."""
_SETTLED_SCALE = 2.0**40
"""Shares are rounded to 2^−40, which has no derivative and no effect."""
_MIN_DIVISOR = 1e-12
"""In place of zero in a division."""


def segment_bound(
    start: ca.SX, along: ca.SX, length: float, other: ca.SX, other_along: ca.SX, other_length: float, radius: float
) -> ca.SX:
    """Lower bound of the distance of two capsules [m]: starts (3,), vectors to the ends (3,), ``radius`` the sum."""
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
    """Distance of a capsule to a ball about ``point`` (3,) [m], exact; ``radius``: sum of both."""
    w, size = start - ca.vertcat(*point), max(length**2, _MIN_DIVISOR)
    s = _settled(_clipped_share(-ca.dot(along, w) / size))
    nearest = w + s * along
    return _bounded_root(_least_value(ca.sumsqr(nearest), s, ca.dot(nearest, along), ca.SX(size))) - radius


def box_bound(start: ca.SX, along: ca.SX, half: Sequence[float], radius: float) -> ca.SX:
    """Lower bound of the distance of a capsule to a box about the origin, half sides (3,) [m]."""
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
    """Lower bound of the distance of a capsule to a solid cylinder about z, ``half`` its length [m]."""
    eps = 4 * BOUND_SLACK_M * 2 * radius
    flat = along[0] ** 2 + along[1] ** 2

    def parts(s: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        x, y, z = ca.vertsplit(start + s * along)
        rho = ca.sqrt(x * x + y * y + 1e-24)  # m², away from zero on the axis
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
    for _ in range(7):
        _, _, slope, curvature = parts(s)
        low, high = ca.if_else(slope < 0, s, low), ca.if_else(slope > 0, s, high)
        newton = s - slope / curvature
        s = ca.if_else((newton < low) + (newton > high), (low + high) / 2, newton)
    s = _settled(s)
    over, above, slope, curvature = parts(s)
    squared = over**2 + above**2 + eps * s * (s - 1) + _settled(-_is_inside(s) * slope**2 * (1 / eps - 1 / curvature))
    return _bounded_root(_least_value(squared, s, slope, curvature)) - radius


def soft_minimum(distances: Sequence[ca.SX]) -> ca.SX:
    """``min(a, b) ≥ (a + b − √((a − b)² + δ²))/2`` pair by pair: at most ``½ δ ⌈log₂ k⌉`` below the least of k [m]."""
    level = list(distances)
    while len(level) > 1:
        pairs = [(level[k], level[k + 1]) for k in range(0, len(level) - 1, 2)]
        paired = [(a + b - ca.sqrt((a - b) ** 2 + SOFT_MINIMUM_WIDTH_M**2)) / 2 for a, b in pairs]
        level = paired + level[len(level) - len(level) % 2 :]
    return level[0]


def _bounded_root(squared: ca.SX) -> ca.SX:
    """The square root [m] of a square [m²], below `_LINEAR_BELOW_M` its tangent: a slope leads out of a collision."""
    return ca.sqrt(ca.fmax(squared, 5e-3**2)) + ca.fmin(squared - 5e-3**2, 0) / (2 * 5e-3)


def _clipped_share(share: ca.SX) -> ca.SX:
    return ca.fmin(ca.fmax(share, 0), 1)


def _settled(value: ca.SX) -> ca.SX:
    return ca.floor(value * _SETTLED_SCALE) / _SETTLED_SCALE


def _is_inside(share: ca.SX) -> ca.SX:
    return (share > 0) * (share < 1)


def _least_value(squared: ca.SX, share: ca.SX, slope: ca.SX, curvature: ca.SX) -> ca.SX:
    """``F − g²/h``: value, half derivative and half second derivative at the minimiser, where g is zero."""
    return squared - _is_inside(share) / _settled(curvature) * slope**2


def _slope_bracket(corners: Sequence[ca.SX], slopes: Sequence[ca.SX]) -> tuple[ca.SX, ca.SX]:
    low, high = ca.SX(0), ca.SX(1)
    for corner, slope in zip(corners, slopes, strict=True):
        low = ca.fmax(low, ca.if_else(slope <= 0, corner, 0))
        high = ca.fmin(high, ca.if_else(slope >= 0, corner, 1))
    return low, high


def _crossing_share(corners: Sequence[ca.SX], slopes: Sequence[ca.SX]) -> ca.SX:
    low, high = _slope_bracket(corners, slopes)
    below, above = ca.SX(-ca.inf), ca.SX(ca.inf)
    for slope in slopes:
        below = ca.fmax(below, ca.if_else(slope <= 0, slope, -ca.inf))
        above = ca.fmin(above, ca.if_else(slope >= 0, slope, ca.inf))
    share = low - below * (high - low) / ca.fmax(above - below, _MIN_DIVISOR)
    return ca.if_else(slopes[0] >= 0, 0, ca.if_else(slopes[1] <= 0, 1, share))
