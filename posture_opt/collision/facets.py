"""Surfaces of bodies as small flat faces, for drawing."""

from __future__ import annotations

import numpy as np

from posture_opt.numerics import TURN, Array


def quads(grid: Array) -> Array:
    """(k, 4, 3) faces between neighbouring points of a grid (a, b, 3) [m], corners in turn."""
    faces = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2)
    return np.asarray(faces.reshape(-1, 4, 3))


def rectangle(middle: Array, u: Array, v: Array, pieces: int) -> Array:
    """(pieces², 4, 3) faces of ``middle ± u ± v``, each (3,) [m]."""
    t = np.linspace(-1.0, 1.0, pieces + 1)
    return quads(middle + t[:, None, None] * u + t[None, :, None] * v)


def revolved(profile: Array, T: Array) -> Array:
    """(k, 4, 3) faces of a profile (m, 2), radius and height [m], turned about z of the frame T (4, 4)."""
    turn = np.linspace(0.0, TURN, 20 + 1)  # faces around
    radius, height = profile.T
    x, y = radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn)
    grid = np.stack([x, y, np.broadcast_to(height[:, None], x.shape)], axis=2)
    return quads(grid @ T[:3, :3].T + T[:3, 3])


def capsule_facets(start: Array, end: Array, radius: float) -> Array:
    """(k, 4, 3) faces of a capsule about a segment from (3,) to (3,) [m]; a ball where they are equal."""
    return tapered_facets(start, end, radius, radius)


def tapered_facets(start: Array, end: Array, start_radius: float, end_radius: float) -> Array:
    """(k, 4, 3) faces of a cone between two balls about (3,) and (3,) [m]."""
    length = float(np.linalg.norm(end - start))
    rise = np.linspace(0.0, np.pi / 2, 5 + 1)  # faces from the rim of a hemisphere to its pole
    cap = np.column_stack([np.cos(rise), np.sin(rise)])
    t = np.arange(1, 6) / 6
    straight = np.column_stack([start_radius + t * (end_radius - start_radius), length * t])
    below, above = start_radius * cap * np.array([1.0, -1.0]), end_radius * cap + np.array([0.0, length])
    return revolved(np.vstack([below[::-1], straight, above]), _frame_along(start, end - start))


def cylinder_facets(start: Array, end: Array, radius: float) -> Array:
    """(k, 4, 3) faces of a cylinder with flat ends about (3,) and (3,) [m]."""
    length = float(np.linalg.norm(end - start))
    profile = np.array([[0.0, 0.0], [radius, 0.0], [radius, length], [0.0, length]])
    return revolved(profile, _frame_along(start, end - start))


def _frame_along(origin: Array, along: Array) -> Array:
    """(4, 4) a frame at a point (3,) whose z axis points along a vector (3,); along the world's for one of length 0."""
    length = float(np.linalg.norm(along))
    z = along / length if length > 0 else np.array([0.0, 0.0, 1.0])
    side = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    side /= np.linalg.norm(side)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.column_stack([side, np.cross(z, side), z]), origin
    return T
