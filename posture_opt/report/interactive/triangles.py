"""Surfaces as triangles with shared corners, as plotly.js draws them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posture_opt.collision.facets import cylinder_facets, tapered_facets
from posture_opt.numerics import Array, Codes, Json
from posture_opt.report.scene.arm_solids import Solid

_CORNER_TOLERANCE_M = 1e-7  # m: corners nearer than this are one
_SHAFT_RADIUS, _HEAD_RADIUS = 0.028, 0.075  # radii of an arrow of length 1
_HEAD_START = 0.74  # where its head begins


@dataclass(frozen=True)
class Triangles:
    """Surfaces as one mesh.

    Args:
        corners: (v, 3) [m]; ``faces`` (t, 3) numbers of the corners of each triangle.
        owner: (t,) number of the surface that each triangle is of.
    """

    corners: Array
    faces: Codes
    owner: Codes

    @classmethod
    def of(cls, surfaces: Sequence[Array]) -> Triangles:
        """Of surfaces, each of faces (k, 4, 3) [m]; no two share a corner. A face with two corners in one is a
        triangle.

        Corners of one surface that agree within 0.1 µm are one, so that the renderer can shade smoothly over edges.
        """
        corners, faces, owner, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=int)], [np.zeros(0, dtype=int)], 0
        for which, surface in enumerate(surfaces):
            flat = surface.reshape(-1, 3)
            _, first, index = np.unique(
                np.round(flat / _CORNER_TOLERANCE_M), axis=0, return_index=True, return_inverse=True
            )
            quad = index.reshape(-1, 4)
            three = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
            whole = (three[:, 0] != three[:, 1]) & (three[:, 1] != three[:, 2]) & (three[:, 2] != three[:, 0])
            corners.append(flat[first])
            faces.append(three[whole] + count)
            owner.append(np.full(int(whole.sum()), which))
            count += len(first)
        return cls(np.concatenate(corners), np.concatenate(faces), np.concatenate(owner))

    def document(self, decimals: int = 1) -> dict[str, Json]:
        """``x, y, z`` [mm] of the corners, and ``i, j, k`` of the triangles."""
        points = np.round(1e3 * self.corners, decimals)
        return {
            **{name: points[:, axis].tolist() for axis, name in enumerate("xyz")},
            **{name: self.faces[:, axis].tolist() for axis, name in enumerate("ijk")},
        }


def solids_document(solids: Sequence[Solid]) -> dict[str, Json]:
    """Solids as one mesh: with its triangles the frame of each corner, and of which part each triangle is.

    The page moves the corners with their frames when another posture is chosen.
    """
    found = Triangles.of([solid.faces for solid in solids])
    frame = np.zeros(len(found.corners), dtype=int)
    frame[found.faces] = np.array([solid.frame for solid in solids])[found.owner][:, None]
    parts = [{"name": solid.name, "role": solid.role} for solid in solids]
    return {**found.document(), "frame": frame.tolist(), "part": found.owner.tolist(), "parts": parts}


def arrow() -> Triangles:
    """An arrow of length 1 along z from the origin: a shaft and a cone."""
    neck, tip = np.array([0.0, 0.0, _HEAD_START]), np.array([0.0, 0.0, 1.0])
    return Triangles.of(
        [cylinder_facets(np.zeros(3), neck, _SHAFT_RADIUS), tapered_facets(neck, tip, _HEAD_RADIUS, 0.0)]
    )


def ball() -> Triangles:
    """A ball of radius 1 about the origin; what flattens it to a disc makes it the region of a planar arm."""
    pole = np.array([0.0, 0.0, 1e-9])
    return Triangles.of([tapered_facets(-pole, pole, 1.0, 1.0)])
