"""The viewer: an orthographic camera, and the one from which most of an arm is seen.

Views from all sides and three heights are scored; the weights are a choice of taste, their order of importance is: arm
hidden near its tool point, size of the outline and arm behind obstacles, direction of the task seen end on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array, Codes

if TYPE_CHECKING:
    from posture_opt.report.scene.arm_geometry import ArmGeometry

_AZIMUTHS = np.radians(np.arange(0, 360, 15))
_ELEVATIONS = np.radians([14.0, 24.0, 34.0])
_FLAT_VIEW_COSINE = 0.98  # cosine of the angle to an axis of the world from which boxes and walls look flat
_OUTLINE_CELLS = 60  # along the arm's extent: the grain in which its outline is compared
_MAX_POINTS = 1500  # of the surface
_CELL_STRIDE = 1_000_003  # more than cells lie above each other
_NEAR_SHARE = 0.05  # of the extent: about the tool point nothing may be in the way
_OUTLINE, _HIDDEN, _BEHIND, _SHORT, _FLAT, _LOW = 2.0, 2.5, 2.0, 0.25, 0.12, 0.1  # weights


@dataclass(frozen=True, eq=False)
class Camera:
    """A view without perspective.

    Args:
        azimuth, elevation: of the viewer seen from the scene [rad].
        lower: (2,) the lower left corner of the picture, to the right and up as the viewer sees it [m].
        size: (2,) width and height of the picture [m].
    """

    azimuth: float
    elevation: float
    lower: Array
    size: Array

    @classmethod
    def at(cls, azimuth: float, elevation: float) -> Camera:
        """A direction of view, the frame to be set by `framing`."""
        return cls(azimuth, elevation, np.zeros(2), np.ones(2))

    @property
    def axes(self) -> Array:
        """(3, 3) unit vectors, one a row, world: to the right, up, and towards the viewer."""
        e, a = self.elevation, self.azimuth
        back = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
        right = np.array([-math.sin(a), math.cos(a), 0.0])
        return np.array([right, np.cross(back, right), back])

    def project(self, points: Array) -> Array:
        """(k, 3) right, up, and towards the viewer of points (k, 3), world [m]."""
        seen: Array = points @ self.axes.T
        return seen

    def framing(self, points: Array, aspect: float, margins: tuple[float, float]) -> Camera:
        """The same view with all points (k, 3) in the picture.

        Args:
            aspect: width of the picture over its height.
            margins: share of the width and of the height that stays free on each side.
        """
        seen = self.project(points)[:, :2]
        low, high = seen.min(axis=0), seen.max(axis=0)
        need = (high - low) / (1 - 2 * np.array(margins))
        height = max(float(need[1]), float(need[0]) / aspect, 1e-6)
        size = np.array([aspect * height, height])
        return replace(self, lower=(low + high - size) / 2, size=size)


def best_camera(geometry: ArmGeometry) -> Camera:
    """The view in which the arm's outline is largest, its tool point free and the direction of the task not end on.

    Weighted sum over 72 views of the area of the outline, the hidden share about the tool point, the share behind
    obstacles, ``cos²`` of the angle between direction and view, and penalties for views along an axis of the world.
    """
    points = _thinned(geometry.points)
    obstacles = np.concatenate([np.zeros((0, 3)), *(_thinned(o.faces.reshape(-1, 3)) for o in geometry.obstacles)])
    views = [Camera.at(a, e) for e, a in product(_ELEVATIONS.tolist(), _AZIMUTHS.tolist())]
    outlines = np.array([_outline(view, points, geometry.extent) for view in views], dtype=float)
    scores = _OUTLINE * outlines / outlines.max()
    for k, view in enumerate(views):
        scores[k] -= _FLAT * (np.abs(view.axes[2, :2]).max() > _FLAT_VIEW_COSINE * math.cos(view.elevation))
        scores[k] -= _LOW * abs(view.elevation - _ELEVATIONS[1]) / _ELEVATIONS[1]
        scores[k] -= _HIDDEN * _hidden(view, geometry, points) + _BEHIND * _behind(view, points, obstacles, geometry)
        if geometry.direction is not None:
            scores[k] -= _SHORT * abs(float(view.axes[2] @ geometry.direction)) ** 2  # end on, no length is seen
    return views[int(np.argmax(scores))]


def _thinned(points: Array) -> Array:
    """Some of many points (k, 3), spread evenly over the list of them."""
    return points if len(points) <= _MAX_POINTS else points[np.linspace(0, len(points) - 1, _MAX_POINTS).astype(int)]


def _outline(view: Camera, points: Array, extent: float) -> int:
    """In how many cells of a grid points (n, 3) are seen."""
    return len(np.unique(_cells(view.project(points), extent / _OUTLINE_CELLS)))


def _cells(seen: Array, side: float) -> Codes:
    """(n,) the cell of each projected point (n, 3), as one number."""
    column, row = np.floor(seen[:, :2] / side).astype(np.int64).T
    return np.asarray(column * _CELL_STRIDE + row)


def _hidden(view: Camera, geometry: ArmGeometry, points: Array) -> float:
    """How much of the surroundings of the tool point the arm hides: 0 to 1."""
    tool, seen = view.project(geometry.tool_point[None])[0], view.project(points)
    near = np.linalg.norm(seen[:, :2] - tool[:2], axis=1) < _NEAR_SHARE * geometry.extent
    before = near & (seen[:, 2] > tool[2] + 2 * _NEAR_SHARE * geometry.extent)
    return float(np.sum(before) / max(int(np.sum(near)), 1))


def _behind(view: Camera, points: Array, obstacles: Array, geometry: ArmGeometry) -> float:
    """Share of the arm's points that obstacles hide.

    Args:
        points: (k, 3) of the arm, ``obstacles`` (m, 3) of the obstacles [m]; compared in cells of the picture.
    """
    if not len(obstacles):
        return 0.0
    side = 3 * geometry.extent / _OUTLINE_CELLS
    seen, blocks = view.project(points), view.project(obstacles)
    taken, at = np.unique(_cells(blocks, side), return_inverse=True)
    nearest = np.full(len(taken) + 1, -np.inf)
    np.maximum.at(nearest, at, blocks[:, 2])
    cells = _cells(seen, side)
    place = np.searchsorted(taken, cells)
    known = taken[np.minimum(place, len(taken) - 1)] == cells
    return float(np.mean(nearest[np.where(known, place, -1)] > seen[:, 2] + 0.02 * geometry.extent))
