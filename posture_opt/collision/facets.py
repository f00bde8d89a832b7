"""Surfaces of bodies as small flat faces, for drawing."""

from __future__ import annotations

import numpy as np

from posture_opt.numerics import Array

_ROUND = 20  # faces around
_LONG = 6  # along a capsule
_CAP = 5  # from the rim of a hemisphere to its pole


def quads(grid: Array) -> Array:
    """(k, 4, 3) the faces between neighbouring points of a grid (a, b, 3) [m]."""
    faces = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2)
    return np.asarray(faces.reshape(-1, 4, 3))


def rectangle(middle: Array, u: Array, v: Array, pieces: int) -> Array:
    """(pieces², 4, 3) the faces of the rectangle ``middle ± u ± v``, each (3,) [m]."""
    t = np.linspace(-1.0, 1.0, pieces + 1)
    return quads(middle + t[:, None, None] * u + t[None, :, None] * v)


def revolved(profile: Array, T: Array) -> Array:
    """(k, 4, 3) the faces of a profile (m, 2) of radius and height [m], turned about z of the frame ``T`` (4, 4)."""
    turn = np.linspace(0.0, 2 * np.pi, _ROUND + 1)
    radius, height = profile.T
    x, y = radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn)
    grid = np.stack([x, y, np.broadcast_to(height[:, None], x.shape)], axis=2)
    return quads(grid @ T[:3, :3].T + T[:3, 3])


def capsule_facets(start: Array, end: Array, radius: float) -> Array:
    """(k, 4, 3) the faces of a capsule about the segment between two points (3,) [m]."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length if length > 0 else np.array([0.0, 0.0, 1.0])
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    side /= np.linalg.norm(side)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.column_stack([side, np.cross(along, side), along]), start
    rise = np.linspace(0.0, np.pi / 2, _CAP + 1)
    cap = np.column_stack([radius * np.cos(rise), radius * np.sin(rise)])
    straight = np.column_stack([np.full(_LONG - 1, radius), length * np.arange(1, _LONG) / _LONG])
    return revolved(np.vstack([(cap * np.array([1.0, -1.0]))[::-1], straight, cap + np.array([0.0, length])]), T)
