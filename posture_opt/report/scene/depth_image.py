"""Which surface is seen at each point of a picture: flat faces into a depth buffer, without sorting them.

Sorting whole bodies or faces by their distance, as mplot3d does, fails where they pass through each other; a buffer of
depths decides at every point (E. Catmull, "A Subdivision Algorithm for Computer Display of Curved Surfaces", 1974).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posture_opt.numerics import Array, Codes
from posture_opt.report.scene.camera import Camera

_MAX_CHUNK_POINTS = 2_000_000  # points that are looked at together
_FACE_TRIANGLES = ((0, 1, 2), (0, 2, 3))  # the triangles of a face
_MIN_BOX_SIDE = 4  # points: side of the smallest box about a triangle


@dataclass(frozen=True, eq=False)
class DepthImage:
    """What is seen at the points of a picture, the first row at the bottom.

    Args:
        depth: (H, W) towards the viewer [m]; -inf where nothing is.
        face: (H, W) index of the face that is seen; -1 where none is.
        weights: (H, W, 4) of the corners of that face there: their sum is 1.
    """

    depth: Array
    face: Codes
    weights: Array

    @classmethod
    def of(cls, faces: Array, camera: Camera, shape: tuple[int, int]) -> DepthImage:
        """Faces (k, 4, 3), world [m], in a picture of (H, W) points.

        A face is two triangles. Triangles with boxes of one size are drawn together, in parts that fit into memory.
        """
        height, width = shape
        depth = np.full(height * width, -np.inf)
        face = np.full(height * width, -1, dtype=np.int64)
        weights = np.zeros((height * width, 4))
        seen = camera.project(faces.reshape(-1, 3)).reshape(-1, 4, 3)
        seen[..., :2] = (seen[..., :2] - camera.lower) * (np.array([width, height]) / camera.size)
        for corners in _FACE_TRIANGLES:
            triangles = seen[:, list(corners)]
            low, high = triangles[..., :2].min(axis=1), triangles[..., :2].max(axis=1)
            inside = np.all((high > 0) & (low < [width, height]), axis=1) & (_area(triangles) != 0)
            reach = np.maximum(np.ceil(high - np.floor(low)), _MIN_BOX_SIDE)
            columns, rows = (2 ** np.ceil(np.log2(reach[:, k])).astype(np.int64) for k in range(2))
            for box in np.unique(np.column_stack([columns, rows])[inside], axis=0).tolist():
                mine = np.flatnonzero(inside & (columns == box[0]) & (rows == box[1]))
                for part in np.array_split(mine, max(len(mine) * box[0] * box[1] // _MAX_CHUNK_POINTS, 1)):
                    at, z, w, k = _covered(triangles[part], box, shape)
                    np.maximum.at(depth, at, z)
                    first = np.flatnonzero(depth[at] == z)
                    at = at[first]
                    face[at] = part[k[first]]
                    weights[at] = 0.0
                    for own, corner in zip(w, corners, strict=True):
                        weights[at, corner] = own[first]
        return cls(depth.reshape(shape), face.reshape(shape), weights.reshape(*shape, 4))


def _area(triangles: Array) -> Array:
    """(k,) twice the areas in the picture, with a sign."""
    a, b, c = (triangles[:, k, :2] for k in range(3))
    u, v = b - a, c - a
    area: Array = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    return area


def _covered(
    triangles: Array, box: list[int], shape: tuple[int, int]
) -> tuple[Codes, Array, tuple[Array, Array, Array], Codes]:
    """The points of the picture (H, W) whose centres triangles (k, 3, 3) cover, each in a box of columns and rows.

    Returns:
        (m,) the points; (m,) their depths; (m,) the weights of each of the three corners; (m,) the triangles.
    """
    height, width = shape
    corner = np.floor(triangles[..., :2].min(axis=1)).astype(np.int64)
    x = corner[:, 0, None, None] + np.arange(box[0])[None, None, :]
    y = corner[:, 1, None, None] + np.arange(box[1])[None, :, None]
    area = _area(triangles)[:, None, None]
    u, v = (_side(triangles[:, (k + 1) % 3], triangles[:, (k + 2) % 3], x, y) / area for k in range(2))
    inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    k, i, j = np.nonzero(inside)
    u, v = u[k, i, j], v[k, i, j]
    w = 1 - u - v
    depth = u * triangles[k, 0, 2] + v * triangles[k, 1, 2] + w * triangles[k, 2, 2]
    return (corner[k, 1] + i) * width + corner[k, 0] + j, depth, (u, v, w), k


def _side(a: Array, b: Array, x: Codes, y: Codes) -> Array:
    """Twice the signed area of a, b and each point of the picture, at its centre."""
    ax, ay, bx, by = (v[:, None, None] for v in (a[:, 0], a[:, 1], b[:, 0], b[:, 1]))
    area: Array = (bx - ax) * (y + 0.5 - ay) - (by - ay) * (x + 0.5 - ax)
    return area
