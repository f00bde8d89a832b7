"""How bright a surface is: normals that are smooth over edges between flat faces, and light from the upper left."""

from __future__ import annotations

import numpy as np

from posture_opt.numerics import Array
from posture_opt.report.scene.camera import Camera
from posture_opt.report.scene.depth_image import DepthImage

_LIGHT_DIRECTION = np.array([-0.45, 0.65, 0.62])  # to the right, up, towards the viewer
_CREASE_COSINE = 0.7  # cosine of the angle between faces from which on their edge is sharp
_CORNER_DIGITS = 7  # digits [m]: corners that agree in them are one


def brightness(image: DepthImage, faces: Array, camera: Camera) -> Array:
    """Brightness (m,) from 0 where no light falls to 1, at the points of an image where something is seen, row by row.

    ``max(n · l, 0)`` with the unit normal n, towards the viewer, and the light l from the upper left (Lambert).

    Args:
        faces: (k, 4, 3) [m] that the image shows.
    """
    there = image.face >= 0
    corners = corner_normals(faces)[image.face[there]]
    normals = camera.project(np.einsum("mk,mkj->mj", image.weights[there], corners))
    normals *= np.where(normals[:, 2:] < 0, -1.0, 1.0) / np.maximum(
        np.linalg.norm(normals, axis=1, keepdims=True), 1e-12
    )
    lit: Array = np.clip(normals @ (_LIGHT_DIRECTION / np.linalg.norm(_LIGHT_DIRECTION)), 0.0, 1.0)
    return lit


def corner_normals(faces: Array) -> Array:
    """At each corner (k, 4, 3) the mean of the unit normals of the faces (k, 4, 3) that meet there without an edge.

    Faces count as smooth up to an angle with the cosine 0.7, about 46 degrees.
    """
    flat = np.cross(faces[:, 3] - faces[:, 1], faces[:, 2] - faces[:, 0])
    flat = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-300)
    _, place = np.unique(faces.reshape(-1, 3).round(_CORNER_DIGITS), axis=0, return_inverse=True)
    order = np.argsort(place.ravel(), kind="stable")
    sizes = np.bincount(place.ravel())
    start = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    own = sizes[place.ravel()[order]]
    one = np.repeat(np.arange(len(order)), own)
    other = np.arange(len(one)) - np.repeat(np.cumsum(own) - own, own) + np.repeat(start[place.ravel()[order]], own)
    a, b = order[one] // 4, order[other] // 4
    smooth = np.sum(flat[a] * flat[b], axis=1) > _CREASE_COSINE
    total = np.zeros((4 * len(faces), 3))
    np.add.at(total, order[one[smooth]], flat[b[smooth]])
    return total.reshape(-1, 4, 3)
