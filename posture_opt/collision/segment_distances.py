"""Exact distances of segments to points, segments, boxes, cylinders and half-spaces, many at once.

All of them are zero where the segment touches or enters the solid, but for the half-space, which knows how deep. The
capsule around a segment is as much nearer as its radius.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from posture_opt.numerics import Array

_TINY = 1e-200  # instead of zero: a point has no direction
_SECANTS = 20  # to rounding


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
        return np.asarray(points - np.clip(points, -half, half))

    along = _nonzero(end - start)
    corners = np.concatenate([(half - start) / along, (-half - start) / along], axis=-1)
    return _least(start, end, excess, corners, steps=1)  # linear between corners


def to_cylinder(start: Array, end: Array, radius: float, half: float) -> Array:
    """(...) distance of segments (..., 3) to the solid cylinder about the z axis from −half to half [m]."""

    def excess(points: Array) -> Array:
        rho = np.linalg.norm(points[..., :2], axis=-1, keepdims=True)
        sideways = points[..., :2] * (np.maximum(rho - radius, 0.0) / np.maximum(rho, _TINY))
        return np.concatenate([sideways, points[..., 2:] - np.clip(points[..., 2:], -half, half)], axis=-1)

    along = end - start
    flat, rise = np.maximum(_dot(along[..., :2], along[..., :2]), _TINY), _nonzero(along[..., 2])
    middle = -_dot(start[..., :2], along[..., :2]) / flat
    beside = start[..., :2] + middle[..., None] * along[..., :2]
    wide = np.sqrt(np.maximum(radius**2 - _dot(beside, beside), 0.0) / flat)
    level = [(side * half - start[..., 2]) / rise for side in (-1, 1)]
    corners = np.stack(np.broadcast_arrays(middle - wide, middle + wide, *level), axis=-1)
    return _least(start, end, excess, corners, steps=_SECANTS)


def _least(start: Array, end: Array, excess: Callable[[Array], Array], corners: Array, steps: int) -> Array:
    """The least distance along the segments to a convex solid; ``excess`` leads from its nearest point to a point.

    The squared distance is convex along the segment, and half its derivative is ``excess · (end − start)``, with
    corners at the shares ``corners`` (..., k). Where it changes its sign is found by secants between the two corners
    beside it, by the Illinois variant of the false position (Dowell and Jarratt 1971).
    """
    start, end = np.broadcast_arrays(start, end)
    along = end - start

    def slope(share: Array) -> Array:
        return _dot(excess(start + share[..., None] * along), along)

    shares = np.concatenate(
        [np.broadcast_to([0.0, 1.0], (*corners.shape[:-1], 2)), np.clip(corners, 0.0, 1.0)], axis=-1
    )
    points = start[..., None, :] + shares[..., None] * along[..., None, :]
    slopes = np.einsum("...ki,...i->...k", excess(points), along)
    low, high = np.max(np.where(slopes <= 0, shares, 0.0), axis=-1), np.min(np.where(slopes >= 0, shares, 1.0), axis=-1)
    below, above = slope(low), slope(high)
    for _ in range(steps):
        share = np.clip(low - below * (high - low) / np.maximum(above - below, _TINY), low, high)
        found = slope(share)
        rising = found > 0
        # An end that stays twice running counts for half, so that it moves too.
        below, above = np.where(rising, below / 2, found), np.where(rising, found, above / 2)
        low, high = np.where(rising, low, share), np.where(rising, share, high)
    ends = [np.linalg.norm(excess(start + share[..., None] * along), axis=-1) for share in (low, high)]
    return np.asarray(np.minimum(*ends))


def _nonzero(values: Array) -> Array:
    return np.where(np.abs(values) > _TINY, values, _TINY)


def _dot(u: Array, v: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", u, v))
