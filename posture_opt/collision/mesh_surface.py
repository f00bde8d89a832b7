"""The surface of a mesh: what is inside, how far bodies about it lie outside, and how it is drawn."""

from __future__ import annotations

import numpy as np

from posture_opt.numerics import TURN, Array, Codes

_MAX_WINDING_FACES = 2000
"""Faces of the mesh that say what is inside; of a finer one neighbouring corners are put together."""
_GRID = 7
"""Points along an edge of a face by which it is measured how far the boxes lie outside."""
_SURFACE_POINTS = 10_000
"""Points on the surface of the mesh that these are compared with."""
_NEIGHBOURS = 24
"""Of these, the triangles of so many are looked at for each point; of a mesh with fewer faces all."""

Corners = tuple[Array, Array]
"""Least and greatest corner (3,), (3,) of a box along the axes [m]."""


def winding(points: Array, triangles: Array) -> Array:
    """(N,) how often the surface winds about points (N, 3): 1 inside, 0 outside, whichever way its faces are turned.

    Van Oosterom & Strackee (1983), IEEE Trans. Biomed. Eng. 30, eq. 8; Jacobson et al. (2013), ACM TOG 32.
    """
    coarse = coarser(triangles, _MAX_WINDING_FACES)
    total = np.zeros(len(points))
    for k in range(0, len(points), 256):
        a, b, c = (coarse[None, :, i] - points[k : k + 256, None] for i in range(3))
        la, lb, lc = (np.linalg.norm(side, axis=2) for side in (a, b, c))
        volume = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("nfi,nfi->nf", *pair) for pair in ((a, b), (b, c), (c, a)))
        total[k : k + 256] = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum(axis=1) * 2 / (2 * TURN)
    return np.abs(total)


def coarser(triangles: Array, most: int) -> Array:
    """Triangles (f, 3, 3) [m], corners that are near each other put together where there are more than ``most``."""
    cell = float(np.ptp(triangles.reshape(-1, 3), axis=0).max()) / 200
    while len(triangles) > most:
        corners = np.round(triangles / cell)
        solid = np.any(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        triangles = np.unique(corners[solid].reshape(-1, 9), axis=0).reshape(-1, 3, 3) * cell
        cell *= 1.5
    return triangles


def finer(triangles: Array) -> Array:
    """Triangles (f, 3, 3) [m], cut in four where a side is beyond a tenth of the mesh: large faces hide each other."""
    most = float(np.ptp(triangles.reshape(-1, 3), axis=0).max()) / 10
    small = [np.zeros((0, 3, 3))]
    while len(triangles):
        large = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1) > most
        small.append(triangles[~large])
        a, b, c = (triangles[large, k] for k in range(3))
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(corners, axis=1) for corners in quarters])
    return np.concatenate(small)


def gap_between(triangles: Array, boxes: list[Corners]) -> float:
    """How far [m] the surface of the union of boxes lies from the mesh at most, measured at points of a grid."""
    rng = np.random.default_rng(0)
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(sides, axis=1)
    chosen = rng.choice(len(triangles), _SURFACE_POINTS, p=area / area.sum())
    u, v = rng.random((2, _SURFACE_POINTS, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = (triangles[chosen, k] for k in range(3))
    surface = np.concatenate([a + u * (b - a) + v * (c - a), triangles.reshape(-1, 3)])
    corners = np.repeat(np.arange(len(triangles)), 3)
    t = np.linspace(0.0, 1.0, _GRID)
    shares = np.stack(np.meshgrid(t, t, t), axis=-1).reshape(-1, 3)
    shares = shares[np.any((shares == 0) | (shares == 1), axis=1)]
    outer = []
    for k, (low, high) in enumerate(boxes):
        points = low + shares * (high - low)
        others = [box for i, box in enumerate(boxes) if i != k]
        covered = [np.all((points >= lower - 1e-9) & (points <= upper + 1e-9), axis=1) for lower, upper in others]
        outer.append(points[~np.any(covered, axis=0)] if covered else points)
    every = np.concatenate(outer)
    return float(_distances(every, surface, np.concatenate([chosen, corners]), triangles).max(initial=0.0))


def _distances(points: Array, surface: Array, owners: Codes, triangles: Array) -> Array:
    """(N,) distance [m] of points (N, 3) to the triangles (f, 3, 3) of the surface points (m, 3) next to them.

    Args:
        owners: (m,) the triangle of each surface point.
    """
    import trimesh
    from scipy.spatial import cKDTree

    few = len(triangles) <= _NEIGHBOURS
    near = owners[cKDTree(surface).query(points, k=_NEIGHBOURS)[1]] if len(points) and not few else None
    found = np.full(len(points), np.inf)
    for k in range(len(triangles) if few else _NEIGHBOURS):
        corners = np.broadcast_to(triangles[k], (len(points), 3, 3)) if near is None else triangles[near[:, k]]
        closest = trimesh.triangles.closest_point(corners, points)  # type: ignore[no-untyped-call]
        found = np.minimum(found, np.linalg.norm(points - closest, axis=1))
    return found
