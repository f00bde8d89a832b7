"""Solids as a shaded picture with outlines, as in a technical illustration, seen by a camera without perspective.

Ground, postures of a motion, obstacles, arm and region are layers. Each has a buffer of depths, which decides at every
point what is seen (E. Catmull, "A Subdivision Algorithm for Computer Display of Curved Surfaces", 1974); sorting faces
by their distance fails where bodies pass through each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array, Codes, Mask, round_below
from posture_opt.report.page.style import WIDTH
from posture_opt.report.scene.arm_solids import COLOURS, Solid

if TYPE_CHECKING:
    from posture_opt.report.scene.arm_geometry import ArmGeometry

DPI = 96  # a page shows a picture at about this
OVERSAMPLING = 2  # points of a buffer to one of the picture, along each side
_LIGHT = np.array([-0.45, 0.65, 0.62]) / np.linalg.norm([-0.45, 0.65, 0.62])  # to the right, up, towards the viewer
_UNLIT = {"obstacle": 0.82, "link": 0.5}  # of a colour where no light falls; links stand for all of the arm
_OPACITY = {"ghost": 0.3, "veiled arm": 0.55, "region": 0.62, "hidden region": 0.3}
_SHADOW, _GRID_LINE, _OUTLINE = 0.86, 0.9, 0.3  # brightness, of the colour below
_MIN_DEPTH_JUMP, _GRID_HALF_WIDTH = 0.012, 0.0012  # of the arm's extent: a step that has an outline; lines of the grid
_CHUNK_POINTS, _MIN_BOX = 2_000_000, 4  # points that are looked at together; least side of the box about a triangle
_VIEWS = tuple(product(np.radians(np.arange(0, 360, 15)).tolist(), np.radians([14.0, 24.0, 34.0]).tolist()))
_COARSE, _SUNLIT = 32, (400, 400)  # points along the pictures by which views are compared; of that from above
Shade = Callable[[Array, Mask], Array]


@dataclass(frozen=True, eq=False)
class Camera:
    """A view without perspective.

    Args:
        axes: (3, 3) unit vectors, one a row, world: to the right, up, and towards the viewer.
        lower: (2,) the lower left corner of the picture, to the right and up as the viewer sees it [m].
        size: (2,) width and height of the picture [m].
    """

    axes: Array
    lower: Array
    size: Array

    @classmethod
    def facing(cls, right: Array, up: Array) -> Camera:
        """The view in which two unit vectors (3,) point to the right and up; the frame is set by `framing`."""
        return cls(np.array([right, up, np.cross(right, up)]), np.zeros(2), np.ones(2))

    @classmethod
    def at(cls, azimuth: float, elevation: float) -> Camera:
        """The view from a direction [rad], z up."""
        right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        ahead = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        return cls.facing(right, math.cos(elevation) * np.array([0.0, 0.0, 1.0]) - math.sin(elevation) * ahead)

    def project(self, points: Array) -> Array:
        """(..., 3) right, up, and towards the viewer of points (..., 3), world [m]."""
        seen: Array = points @ self.axes.T
        return seen

    def shares(self, points: Array) -> Array:
        """(..., 2) where points (..., 3) are in the picture: 0 to 1 from left to right and from below upwards."""
        return np.asarray((self.project(points)[..., :2] - self.lower) / self.size)

    def framing(self, points: Array, aspect: float, margins: tuple[float, float, float, float]) -> Camera:
        """The view with all points (k, 3) in the picture.

        Args:
            aspect: width of the picture over its height.
            margins: share of the picture that stays free to the left, to the right, below and above.
        """
        seen, (left, right, below, above) = self.project(points)[:, :2], margins
        low, free = seen.min(axis=0), np.array([1 - left - right, 1 - below - above])
        need = (seen.max(axis=0) - low) / free
        height = max(float(need[1]), float(need[0]) / aspect, 1e-6)
        size = np.array([aspect * height, height])
        spare = (size - need) * free / 2
        return replace(self, lower=low - spare - size * [left, below], size=size)


@dataclass(frozen=True, eq=False)
class Layer:
    """What is seen of some solids at the points (H, W) of a picture, the first row at the bottom.

    Args:
        depth: (H, W) towards the viewer [m]; -inf where nothing is.
        owner: (H, W) number of the solid that is seen; -1 where none is.
        normals: (H, W, 3) of its surface, to the right, up and towards the viewer.
    """

    solids: Sequence[Solid]
    depth: Array
    owner: Codes
    normals: Array

    @classmethod
    def of(cls, solids: Sequence[Solid], camera: Camera, shape: tuple[int, int]) -> Layer:
        """What the camera sees of solids in a picture of (H, W) points."""
        count = math.prod(shape)
        depth, owner, normals = np.full(count, -np.inf), np.full(count, -1), np.zeros((count, 3))
        if solids:
            faces = np.concatenate([solid.faces for solid in solids])
            seen = np.concatenate([camera.shares(faces) * shape[::-1], camera.project(faces)[..., 2:]], axis=-1)
            corners, slopes = (
                np.concatenate([a[:, [0, 1, 2]], a[:, [0, 2, 3]]])
                for a in (seen, camera.project(np.concatenate([solid.normals for solid in solids])))
            )
            owners = np.tile(np.repeat(np.arange(len(solids)), [len(solid.faces) for solid in solids]), 2)
            for at, z, which, weights in _covered(corners, shape):
                np.maximum.at(depth, at, z)
                first = depth[at] == z
                at, which = at[first], which[first]
                owner[at] = owners[which]
                normals[at] = np.einsum("mk,mkj->mj", weights[first], slopes[which])
        return cls(solids, depth.reshape(shape), owner.reshape(shape), normals.reshape(*shape, 3))

    @property
    def there(self) -> Mask:
        """(H, W) where anything is seen."""
        return np.asarray(self.owner >= 0)

    def lay_over(self, colour: Array, opacity: Array | float, jump: float, shade: Shade | None = None) -> None:
        """Draws the solids over a picture, lit by Lambert's rule, with outlines where the depth jumps [m]; ``colour``
        (H, W, 3), ``opacity`` (H, W), ``shade`` (k,)."""
        there = self.there
        if not there.any():
            return
        unlit = np.array([_UNLIT.get(solid.role, _UNLIT["link"]) for solid in self.solids])[self.owner[there]]
        normals = self.normals[there]
        sign = np.where(normals[:, 2] < 0, -1.0, 1.0) / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
        light = unlit + (1 - unlit) * np.clip(sign * (normals @ _LIGHT), 0.0, 1.0)
        light *= 1.0 if shade is None else shade(self.depth, there)
        painted = np.array([_rgb(COLOURS[solid.role]) for solid in self.solids])[self.owner[there]] * light[:, None]
        grey = np.full(there.shape, -1.0)
        grey[there] = painted.mean(axis=1)
        painted[self._outline(grey, jump)[there]] *= _OUTLINE
        alpha = np.broadcast_to(opacity, there.shape)[there][:, None]
        colour[there] = (1 - alpha) * colour[there] + alpha * painted

    def _outline(self, light: Array, jump: float) -> Mask:
        """(H, W) where one body ends and another or nothing begins, or the depth jumps."""
        edge = np.zeros(self.depth.shape, dtype=bool)
        depth = np.where(self.there, self.depth, -1e9)
        for axis in (0, 1):
            one, other = (np.s_[:-1], np.s_[1:]) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
            # Bodies that touch have an outline between them from a difference of 0.08 in brightness on.
            differ = (self.owner[one] != self.owner[other]) & (np.abs(light[one] - light[other]) > 0.08)
            differ |= np.abs(depth[one] - depth[other]) > jump
            edge[one] |= differ
            edge[other] |= differ
        return edge & self.there


def picture_of(
    geometry: ArmGeometry, camera: Camera, height: float, ghosts: Sequence[Solid] = ()
) -> tuple[Array, Mask, dict[str, Mask]]:
    """The posture with its region, its obstacles and the ground, as wide as figures are.

    An obstacle before the arm is half transparent, so that no posture is hidden; what is behind the upper side of an
    obstacle stays hidden. Of the region, what the arm hides is fainter.

    Args:
        height: of the picture [inch].
        ghosts: solids of other postures of a motion, drawn faintly.

    Returns:
        (H, W, 3) red, green, blue from 0 to 1, the first row at the bottom; (H, W) where the arm or the region is seen;
        by name, (H, W) where an obstacle is.
    """
    rows, columns = (OVERSAMPLING * round(side * DPI) for side in (height, WIDTH))
    around = [solid for solid in geometry.obstacles if not solid.level]
    extent, (axes, offset) = geometry.extent, geometry.ground
    faint, blocks, arm, region = (
        Layer.of(solids, camera, (rows, columns))
        for solids in (ghosts, around, geometry.solids, [Solid("region", "region", -1, geometry.region.faces(24))])
    )
    sunlight = Camera.facing(*axes).framing(geometry.points, 1.0, (0.01,) * 4)
    lit = Layer.of(geometry.solids, sunlight, _SUNLIT).depth

    def shade(depth: Array, there: Mask) -> Array:
        """Brightness of what is seen at a depth (H, W) [m]: less where the arm is above."""
        world = _world(camera, depth, there)
        column, row = (sunlight.shares(world) * _SUNLIT[0]).astype(int).clip(0, _SUNLIT[0] - 1).T
        above = lit[row, column] > sunlight.project(world)[:, 2] + 1e-3 * extent
        return np.where(above, _SHADOW, 1.0)

    (right, up), (a, b, c) = _screen(camera, (rows, columns)), camera.axes @ np.cross(*axes)
    step = round_below(extent / 5)
    ground = (offset - right * a - up * b) / c  # it goes on without end
    everywhere = np.ones(ground.shape, dtype=bool)
    place = _world(camera, ground, everywhere) @ axes.T / step
    lines = np.any(np.abs(place - np.round(place)) * step < _GRID_HALF_WIDTH * extent, axis=1)
    bright = np.where(lines, _GRID_LINE, 1.0) * shade(ground, everywhere)
    colour = (bright[:, None] * _rgb(COLOURS["floor"])).reshape(rows, columns, 3)
    blocks = replace(blocks, owner=np.where(blocks.depth > ground - 1e-6, blocks.owner, -1))
    # What is behind the upper side of an obstacle, up to a slope with the cosine 0.95, is in it or under it.
    upwards = np.abs(blocks.normals @ camera.axes[:, 2]) > 0.95 * np.linalg.norm(blocks.normals, axis=2)
    veil = np.where(upwards & blocks.there, 0.0, _OPACITY["veiled arm"])
    behind = (region.depth < arm.depth) & (not geometry.planar)
    jump = _MIN_DEPTH_JUMP * extent
    faint.lay_over(colour, _OPACITY["ghost"], jump)
    blocks.lay_over(colour, 1.0, jump, shade)
    arm.lay_over(colour, np.where(blocks.there & (blocks.depth > arm.depth), veil, 1.0), jump)
    region.lay_over(colour, np.where(behind, _OPACITY["hidden region"], _OPACITY["region"]), jump)
    fine = colour.reshape(rows // OVERSAMPLING, OVERSAMPLING, columns // OVERSAMPLING, OVERSAMPLING, 3)
    body = (arm.there | region.there)[::OVERSAMPLING, ::OVERSAMPLING]
    seen = blocks.owner[::OVERSAMPLING, ::OVERSAMPLING]
    masks = {solid.name: (seen == k) & ~body for k, solid in enumerate(around)}
    return np.clip(fine.mean(axis=(1, 3)), 0.0, 1.0), body, masks


def best_camera(geometry: ArmGeometry) -> Camera:
    """The view in which the arm's outline is largest, its tool point free and the direction of the task not end on.

    A planar arm is seen along the normal of its plane. The weights are a choice of taste; in their order of importance:
    arm hidden near its tool point, size of the outline and arm behind obstacles, direction of the task seen end on.
    """
    if geometry.planar:
        return Camera.facing(*geometry.ground[0])
    around = [solid.faces for solid in geometry.obstacles if not solid.level]
    blocks, tool = np.concatenate([np.zeros((0, 4, 3)), *around]).reshape(-1, 3), geometry.tool_point
    views = [Camera.at(*view).framing(geometry.points, 1.0, (0.05,) * 4) for view in _VIEWS]
    scores, outlines = np.zeros(len(views)), np.zeros(len(views))
    for k, (view, (_, elevation)) in enumerate(zip(views, _VIEWS, strict=True)):
        arm, before = _coarse_depth(view, geometry.points), _coarse_depth(view, blocks)
        there = np.isfinite(arm)
        outlines[k] = np.count_nonzero(there) * np.prod(view.size)
        column, row = (view.shares(tool) * _COARSE).astype(int)
        about = np.s_[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        hidden = np.mean(arm[about] > float(view.project(tool)[2]) + 0.1 * geometry.extent)
        behind = np.mean(before[there] > arm[there] + 0.02 * geometry.extent)
        end_on = 0.0 if geometry.direction is None else float(view.axes[2] @ geometry.direction) ** 2
        flat = np.abs(view.axes[2, :2]).max() > 0.98 * math.cos(elevation)  # along an axis of the world boxes look flat
        low = abs(math.degrees(elevation) - 24) / 24
        scores[k] = -2.5 * hidden - 2.0 * behind - 0.25 * end_on - 0.12 * flat - 0.1 * low
    return views[int(np.argmax(scores + 2.0 * outlines / outlines.max()))]


def _coarse_depth(view: Camera, points: Array) -> Array:
    """(n, n) depth of the foremost of points (k, 3) in each cell of the picture [m]; -inf where none is."""
    depth = np.full((_COARSE, _COARSE), -np.inf)
    inside = np.all(np.abs(view.shares(points) - 0.5) < 0.5, axis=1)
    column, row = (view.shares(points)[inside] * _COARSE).astype(int).T
    np.maximum.at(depth, (row, column), view.project(points)[inside, 2])
    return depth


def _screen(camera: Camera, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """(W,) and (H, 1) where the points of a picture are, to the right and up [m]."""
    (high, wide), (left, low) = shape, camera.lower
    right = left + (np.arange(wide) + 0.5) * camera.size[0] / wide
    return right, (low + (np.arange(high) + 0.5) * camera.size[1] / high)[:, None]


def _world(camera: Camera, depth: Array, there: Mask) -> Array:
    """(k, 3) where some points (H, W) of a picture are, given their depths (H, W), world [m]."""
    right, up = _screen(camera, depth.shape)
    row, column = np.nonzero(there)
    return np.asarray(np.column_stack([right[column], up[row, 0], depth[there]]) @ camera.axes)


def _covered(corners: Array, shape: tuple[int, int]) -> Iterator[tuple[Codes, Array, Codes, Array]]:
    """The points of a picture (H, W) whose centres triangles cover, those with boxes of one size at a time; ``corners``
    (k, 3, 3)."""
    size = np.array(shape[::-1])
    low = np.floor(corners[..., :2].min(axis=1)).astype(np.int64)
    high = corners[..., :2].max(axis=1)
    (ux, uy), (vx, vy) = (corners[:, 1, :2] - corners[:, 0, :2]).T, (corners[:, 2, :2] - corners[:, 0, :2]).T
    area = ux * vy - uy * vx
    seen = np.all((high > 0) & (low < size), axis=1) & (area != 0)
    boxes = 2 ** np.ceil(np.log2(np.maximum(np.ceil(high - low), _MIN_BOX))).astype(np.int64)
    for wide, tall in sorted(set(map(tuple, boxes[seen].tolist()))):
        mine = np.flatnonzero(seen & (boxes[:, 0] == wide) & (boxes[:, 1] == tall))
        for part in np.array_split(mine, len(mine) * wide * tall // _CHUNK_POINTS + 1):
            x = low[part, 0, None, None] + np.arange(wide)
            y = low[part, 1, None, None] + np.arange(tall)[:, None]
            dx, dy = (x + 0.5 - corners[part, 0, 0, None, None]), (y + 0.5 - corners[part, 0, 1, None, None])
            v = (dy * ux[part, None, None] - dx * uy[part, None, None]) / area[part, None, None]
            u = (dx * vy[part, None, None] - dy * vx[part, None, None]) / area[part, None, None]
            inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (x >= 0) & (x < size[0]) & (y >= 0) & (y < size[1])
            k, i, j = np.nonzero(inside)
            weights = np.column_stack([1 - u[k, i, j] - v[k, i, j], u[k, i, j], v[k, i, j]])
            depth = np.sum(weights * corners[part[k], :, 2], axis=1)
            yield (low[part[k], 1] + i) * shape[1] + low[part[k], 0] + j, depth, part[k], weights


def _rgb(colour: str) -> Array:
    """(3,) red, green and blue from 0 to 1."""
    from matplotlib.colors import to_rgb

    return np.array(to_rgb(colour))
