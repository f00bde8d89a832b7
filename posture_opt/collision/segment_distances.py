"""Exact distances of segments to points, segments, boxes, cylinders and half-spaces, many at once.

All of them are zero where the segment touches or enters the solid, but for the half-space, which knows how deep. The
capsule around a segment is as much nearer as its radius.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from posture_opt.numerics import Array

_TINY = 1e-300  # instead of zero squared length: a point has no direction
_HALVINGS = 60  # of the segment: to rounding


def to_point(start: Array, end: Array, point: Array) -> Array:
    """(...) distance of the segments from ``start`` to ``end`` (..., 3) to ``point`` (3,) or (..., 3) [m]."""
    along, away = end - start, point - start
    share = np.clip(_dot(away, along) / np.maximum(_dot(along, along), _TINY), 0.0, 1.0)
    return np.asarray(np.linalg.norm(away - share[..., None] * along, axis=-1))


def to_segment(start: Array, end: Array, other_start: Array, other_end: Array) -> Array:
    """(...) distance of segments (..., 3) to other segments (..., 3) [m], parallel ones and points among them.

    The least distance is reached at an end of one of the two, or in the interior of both (Lumelsky 1985).
    """
    ends = [
        to_point(other_start, other_end, start),
        to_point(other_start, other_end, end),
        to_point(start, end, other_start),
        to_point(start, end, other_end),
    ]
    u, v, w = end - start, other_end - other_start, start - other_start
    a, b, c, d, e = _dot(u, u), _dot(u, v), _dot(v, v), _dot(u, w), _dot(v, w)
    size = np.maximum(a * c - b * b, _TINY)
    s, t = (b * e - c * d) / size, (a * e - b * d) / size
    inside = (s > 0) & (s < 1) & (t > 0) & (t < 1)
    s, t = np.where(inside, s, 0.0), np.where(inside, t, 0.0)
    across = np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
    return np.asarray(np.minimum(np.min(np.broadcast_arrays(*ends), axis=0), np.where(inside, across, np.inf)))


def to_half_space(start: Array, end: Array, normal: Array, offset: float) -> Array:
    """(...) least height of the segments (..., 3) over the plane ``normal · x = offset``; negative below it [m]."""
    return np.asarray(np.minimum(start @ normal, end @ normal) - offset)


def to_box(start: Array, end: Array, half: Array) -> Array:
    """(...) distance of segments (..., 3) to the box of half sides ``half`` (3,) about the origin [m]."""

    def excess(points: Array) -> Array:
        return np.asarray(np.sign(points) * np.maximum(np.abs(points) - half, 0.0))

    return _least(start, end, excess)


def to_cylinder(start: Array, end: Array, radius: float, half: float) -> Array:
    """(...) distance of segments (..., 3) to the solid cylinder about the z axis from −half to half [m]."""

    def excess(points: Array) -> Array:
        rho = np.linalg.norm(points[..., :2], axis=-1)
        beyond = np.maximum(rho - radius, 0.0) / np.maximum(rho, math.sqrt(_TINY))
        z = points[..., 2]
        high = np.sign(z) * np.maximum(np.abs(z) - half, 0.0)
        return np.concatenate([beyond[..., None] * points[..., :2], high[..., None]], axis=-1)

    return _least(start, end, excess)


def _least(start: Array, end: Array, excess: Callable[[Array], Array]) -> Array:
    """The least distance along the segments to a convex solid; ``excess`` leads from its nearest point to a point.

    The squared distance is convex along the segment, and half its derivative is ``excess · (end − start)``: where that
    changes its sign is found by halving.
    """
    start, end = np.broadcast_arrays(start, end)
    along = end - start
    low, high = np.zeros(start.shape[:-1]), np.ones(start.shape[:-1])
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        rising = _dot(excess(start + middle[..., None] * along), along) > 0
        low, high = np.where(rising, low, middle), np.where(rising, middle, high)
    shares = (low, high)
    return np.asarray(
        np.min([np.linalg.norm(excess(start + share[..., None] * along), axis=-1) for share in shares], axis=0)
    )


def _dot(u: Array, v: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", u, v))
