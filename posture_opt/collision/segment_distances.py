"""Exact distances of segments to points, segments and solids, many at once; zero where they enter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from posture_opt.numerics import Array

_MIN_DIVISOR = 1e-200
"""In place of zero in a division: a point has no direction."""


def to_point(start: Array, end: Array, point: Array) -> Array:
    """(...) distance of segments from (..., 3) to (..., 3) to points (..., 3) [m]."""
    along, away = end - start, point - start
    share = np.clip(_row_dot(away, along) / np.maximum(_row_dot(along, along), _MIN_DIVISOR), 0.0, 1.0)
    return np.asarray(np.linalg.norm(away - share[..., None] * along, axis=-1))


def to_segment(start: Array, end: Array, other_start: Array, other_end: Array) -> Array:
    """(...) distance of segments (..., 3) [m], reached at an end of one or inside both (Lumelsky 1985)."""
    ends = [
        to_point(other_start, other_end, start),
        to_point(other_start, other_end, end),
        to_point(start, end, other_start),
        to_point(start, end, other_end),
    ]
    u, v, w = end - start, other_end - other_start, start - other_start
    a, b, c, d, e = _row_dot(u, u), _row_dot(u, v), _row_dot(v, v), _row_dot(u, w), _row_dot(v, w)
    size = np.maximum(a * c - b * b, _MIN_DIVISOR)
    s, t = (b * e - c * d) / size, (a * e - b * d) / size
    inside = (s > 0) & (s < 1) & (t > 0) & (t < 1)
    s, t = np.where(inside, s, 0.0), np.where(inside, t, 0.0)
    across = np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
    return np.asarray(np.minimum(np.min(np.broadcast_arrays(*ends), axis=0), np.where(inside, across, np.inf)))


def to_box(start: Array, end: Array, half: Array) -> Array:
    """(...) distance of segments (..., 3) to a box about the origin, half sides (3,) [m]."""

    def excess(points: Array) -> Array:
        return np.asarray(points - np.clip(points, -half, half))

    along = _away_from_zero(end - start)
    corners = np.concatenate([(half - start) / along, (-half - start) / along], axis=-1)
    return _least_distance(start, end, excess, corners, steps=1)  # linear between corners


def to_cylinder(start: Array, end: Array, radius: float, half: float) -> Array:
    """(...) distance of segments (..., 3) to a solid cylinder about z, ``half`` its length [m]."""

    def excess(points: Array) -> Array:
        rho = np.linalg.norm(points[..., :2], axis=-1, keepdims=True)
        sideways = points[..., :2] * (np.maximum(rho - radius, 0.0) / np.maximum(rho, _MIN_DIVISOR))
        return np.concatenate([sideways, points[..., 2:] - np.clip(points[..., 2:], -half, half)], axis=-1)

    along = end - start
    flat, rise = np.maximum(_row_dot(along[..., :2], along[..., :2]), _MIN_DIVISOR), _away_from_zero(along[..., 2])
    middle = -_row_dot(start[..., :2], along[..., :2]) / flat
    foot = start[..., :2] + middle[..., None] * along[..., :2]
    wide = np.sqrt(np.maximum(radius**2 - _row_dot(foot, foot), 0.0) / flat)
    level = [(side * half - start[..., 2]) / rise for side in (-1, 1)]
    corners = np.stack(np.broadcast_arrays(middle - wide, middle + wide, *level), axis=-1)
    return _least_distance(start, end, excess, corners, steps=20)  # reach rounding


def _least_distance(start: Array, end: Array, excess: Callable[[Array], Array], corners: Array, steps: int) -> Array:
    """(...) least distance to a convex solid: zero of ``excess · (end − start)``, convex along the segment."""
    start, end = np.broadcast_arrays(start, end)
    along = end - start

    def slope(share: Array) -> Array:
        return _row_dot(excess(start + share[..., None] * along), along)

    shares = np.concatenate(
        [np.broadcast_to([0.0, 1.0], (*corners.shape[:-1], 2)), np.clip(corners, 0.0, 1.0)], axis=-1
    )
    points = start[..., None, :] + shares[..., None] * along[..., None, :]
    slopes = np.einsum("...ki,...i->...k", excess(points), along)
    low, high = np.max(np.where(slopes <= 0, shares, 0.0), axis=-1), np.min(np.where(slopes >= 0, shares, 1.0), axis=-1)
    below, above = slope(low), slope(high)
    # False position, Illinois variant (Dowell and Jarratt 1971); one step where the slope is linear.
    for _ in range(steps):
        share = np.clip(low - below * (high - low) / np.maximum(above - below, _MIN_DIVISOR), low, high)
        found = slope(share)
        rising = found > 0
        # An end that stays twice running counts for half, so that it moves too.
        below, above = np.where(rising, below / 2, found), np.where(rising, found, above / 2)
        low, high = np.where(rising, low, share), np.where(rising, share, high)
    ends = [np.linalg.norm(excess(start + share[..., None] * along), axis=-1) for share in (low, high)]
    return np.asarray(np.minimum(*ends))


def _away_from_zero(values: Array) -> Array:
    return np.where(np.abs(values) > _MIN_DIVISOR, values, _MIN_DIVISOR)


def _row_dot(u: Array, v: Array) -> Array:
    """(...) scalar products of vectors (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", u, v))
