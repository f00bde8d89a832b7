"""The arm and the obstacles as a shaded picture with outlines, as in a technical illustration.

Floor, postures of a motion, obstacles, arm and region are drawn one after the other; depth buffers decide what of each
is seen. The picture is rendered at twice its size and averaged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from posture_opt.numerics import Array, Codes, Mask
from posture_opt.report.page.colours import BLUE, ORANGE
from posture_opt.report.page.style import WIDTH
from posture_opt.report.scene.arm_solids import Solid, is_level
from posture_opt.report.scene.camera import Camera
from posture_opt.report.scene.depth_image import DepthImage
from posture_opt.report.scene.shading import brightness

if TYPE_CHECKING:
    from posture_opt.report.scene.arm_geometry import ArmGeometry

COLOURS = {
    "base": "#3C4146",
    "link": "#D3DBE2",
    "joint": BLUE,
    "tool": "#53585E",
    "obstacle": "#F2DFCA",
    "region": ORANGE,
}
"""By role, from dark to light also in grey."""
FLOOR = "#F3F3F3"
_OVERSAMPLING = 2  # points of the buffers to one of the picture, along each side
_DARK, _DULL = 0.5, 0.82  # of a colour where no light falls: of the arm, and of the obstacles
_MIN_EDGE_CONTRAST = 0.08  # difference of brightness from which two bodies that touch have an outline between them
_FADE_DISTANCE = 0.35  # of the arm's extent: over that way the lines on the floor fade
_DPI = 96  # a page shows it at about this
_GHOST_OPACITY = 0.3  # opacity
_SHADOW_BRIGHTNESS = 0.86  # of the colour of what the arm keeps the light from above from
_LEVEL_COSINE = 0.95  # cosine of the slope up to which a face is the top of something
_VEIL_OPACITY = 0.45  # opacity of an obstacle before the arm
_REGION, _REGION_BEHIND = 0.62, 0.3  # opacity of the region of scatter, and of what of it the arm hides
_MIN_DEPTH_JUMP = 0.012  # of the arm's extent: a step in depth that has an outline
_LINE_BRIGHTNESS = 0.3  # brightness of outlines
_GRID_HALF_WIDTH = 0.0012  # of the arm's extent: half width of the lines on the floor
_SHADOW_POINTS = 400  # points along the side of the picture from above


@dataclass(frozen=True, eq=False)
class SceneImage:
    """A picture of a posture, (H, W) points at 96 dpi over the full width of figures.

    Args:
        geometry: what is drawn; ``camera`` from where.
        height: of the picture [inch].
        ghosts: bodies that are drawn faintly behind all else: other postures of a motion.
    """

    geometry: ArmGeometry
    camera: Camera
    height: float
    ghosts: Sequence[Solid] = ()

    @cached_property
    def pixels(self) -> Array:
        """The picture (H, W, 3) as red, green, blue from 0 to 1, the first row at the bottom.

        An obstacle before the arm is drawn half transparent, so that no posture is hidden; what is behind the upper
        side of an obstacle stays hidden. Of the region, what the arm hides is fainter.
        """
        colour = np.ones((*self._shape, 3))
        self._draw_floor(colour)
        ghosts = DepthImage.of(_faces(self.ghosts), self.camera, self._shape)
        self._lay(colour, ghosts, self.ghosts, _GHOST_OPACITY)
        shown = np.where(self._blocks.depth > self._floor_depth - 1e-6, self._blocks.face, -1)
        self._lay(colour, replace(self._blocks, face=shown), self._around, 1.0)
        veiled = np.where(self._topped, 0.0, 1 - _VEIL_OPACITY)
        seen = np.where(self._blocks.depth > self._arm.depth, veiled, 1.0)
        self._lay(colour, self._arm, self.geometry.solids, seen)
        seen = np.where(self._region.depth >= self._arm.depth, _REGION, _REGION_BEHIND)
        self._lay(colour, self._region, (self._ellipsoid,), seen)
        fine = colour.reshape(
            self._shape[0] // _OVERSAMPLING, _OVERSAMPLING, self._shape[1] // _OVERSAMPLING, _OVERSAMPLING, 3
        )
        return np.asarray(np.clip(fine.mean(axis=(1, 3)), 0.0, 1.0))

    @cached_property
    def arm_mask(self) -> Mask:
        """(H, W) where the arm or the region is seen."""
        there = (self._arm.face >= 0) | (self._region.face >= 0)
        return np.asarray(there[::_OVERSAMPLING, ::_OVERSAMPLING])

    @cached_property
    def filled(self) -> Mask:
        """(H, W) where anything but the floor is seen."""
        there = (self._arm.face >= 0) | (self._region.face >= 0) | (self._blocks.face >= 0)
        return np.asarray(there[::_OVERSAMPLING, ::_OVERSAMPLING])

    def obstacle_anchors(self) -> list[tuple[str, Array]]:
        """Each obstacle that is seen with a point (2,) of the picture in it, away from the arm [m].

        An obstacle that is the floor is labelled near the lower edge.
        """
        there = (self._blocks.face >= 0) & (self._arm.face < 0) & (self._region.face < 0)
        owner = np.repeat(np.arange(len(self._around)), [len(o.faces) for o in self._around])
        right, up = self._screen
        found: list[tuple[str, Array]] = []
        for k, obstacle in enumerate(self._around):
            row, column = np.nonzero(there & (owner[self._blocks.face] == k))
            if len(row):
                middle = np.argmin((row - np.median(row)) ** 2 + (column - np.median(column)) ** 2)
                found.append((obstacle.name, np.array([right[column[middle]], up[row[middle]]])))
        floor = np.isfinite(self._floor_depth) & (self._arm.face < 0) & (self._blocks.face < 0)
        if self._ground is not None and self._ground.role == "obstacle" and floor.any():
            found.append((self._ground.name, np.array([right[self._shape[1] // 2], up[self._shape[0] // 8]])))
        return found

    @property
    def _shape(self) -> tuple[int, int]:
        """Rows and columns of the buffers, twice those of the picture."""
        return _OVERSAMPLING * round(self.height * _DPI), _OVERSAMPLING * round(WIDTH * _DPI)

    @cached_property
    def _arm(self) -> DepthImage:
        """What is seen of the arm alone."""
        return DepthImage.of(_faces(self.geometry.solids), self.camera, self._shape)

    @cached_property
    def _blocks(self) -> DepthImage:
        """What is seen of the obstacles alone."""
        return DepthImage.of(_faces(self._around), self.camera, self._shape)

    @cached_property
    def _ellipsoid(self) -> Solid:
        """The enlarged 95 % region as a body."""
        return Solid("region", "region", -1, self.geometry.region.faces(24))

    @cached_property
    def _topped(self) -> Mask:
        """(H, W) where the upper side of an obstacle is seen: what is behind it is in it or under it."""
        faces = _faces(self._around)
        if not len(faces):
            return np.zeros(self._shape, dtype=bool)
        normals = np.cross(faces[:, 3] - faces[:, 1], faces[:, 2] - faces[:, 0])
        level = np.abs(normals[:, 2]) > _LEVEL_COSINE * np.linalg.norm(normals, axis=1)
        return np.asarray((self._blocks.face >= 0) & level[self._blocks.face])

    @cached_property
    def _region(self) -> DepthImage:
        """What is seen of the region alone."""
        return DepthImage.of(self._ellipsoid.faces, self.camera, self._shape)

    @cached_property
    def _around(self) -> tuple[Solid, ...]:
        """The obstacles without those that are a floor."""
        return tuple(o for o in self.geometry.obstacles if not is_level(o))

    @cached_property
    def _ground(self) -> Solid | None:
        """The floor, or the obstacle that is one."""
        level = [o for o in self.geometry.obstacles if is_level(o)]
        return level[0] if level else self.geometry.floor

    @cached_property
    def _floor_depth(self) -> Array:
        """(H, W) depth of the floor, which goes on without end [m]; -inf where there is none."""
        if self._ground is None:
            return np.full(self._shape, -np.inf)
        right, up = self._screen
        _, upwards, back = self.camera.axes
        depth: Array = (float(self._ground.faces[0, 0, 2]) - up[:, None] * upwards[2]) / back[2] + 0.0 * right
        return depth

    @property
    def _screen(self) -> tuple[Array, Array]:
        """(W,) and (H,) where the points of the picture are, to the right and up [m]."""
        height, width = self._shape
        (left, low), (wide, high) = self.camera.lower, self.camera.size
        return left + (np.arange(width) + 0.5) * wide / width, low + (np.arange(height) + 0.5) * high / height

    def _world(self, depth: Array, there: Mask) -> Array:
        """(m, 3) where some points (H, W) of the picture are in the world, given their depths (H, W) [m]."""
        right, up = self._screen
        row, column = np.nonzero(there)
        world: Array = np.column_stack([right[column], up[row], depth[there]]) @ self.camera.axes
        return world

    def _draw_floor(self, colour: Array) -> None:
        """The floor with lines that fade away from the arm, and the shadow of the arm.

        Args:
            colour: (H, W, 3), changed in place.
        """
        there = np.isfinite(self._floor_depth)
        if not there.any():
            return
        world = self._world(self._floor_depth, there)
        step, width = grid_step(self.geometry.extent), _GRID_HALF_WIDTH * self.geometry.extent
        near = np.any(np.abs(world[:, :2] / step - np.round(world[:, :2] / step)) * step < width, axis=1)
        points = self.geometry.points[:, :2]
        outside = np.maximum(points.min(axis=0) - world[:, :2], world[:, :2] - points.max(axis=0)).max(axis=1)
        faint = np.clip(outside / (_FADE_DISTANCE * self.geometry.extent), 0.0, 1.0)
        shade = np.where(near, 0.86 + 0.11 * faint, 1.0) * np.where(self._shaded(world), _SHADOW_BRIGHTNESS, 1.0)
        colour[there] = _rgb(FLOOR) * shade[:, None]

    def _lay(self, colour: Array, image: DepthImage, solids: Sequence[Solid], opacity: float | Array) -> None:
        """Draws what an image shows of solids over what is there, lit and with outlines.

        Args:
            colour: (H, W, 3), changed in place: ``(1 − α) colour + α painted``.
            opacity: α, a number or (H, W).
        """
        there = image.face >= 0
        if not there.any():
            return
        owner = np.repeat(np.arange(len(solids)), [len(solid.faces) for solid in solids])
        base = np.array([_rgb(COLOURS[solid.role]) for solid in solids])
        around = solids is self._around
        dark = _DULL if around else _DARK
        painted = base[owner[image.face[there]]]
        painted = painted * (dark + (1 - dark) * brightness(image, _faces(solids), self.camera))[:, None]
        if around:
            world = self._world(image.depth, there)
            painted = painted * np.where(self._shaded(world), _SHADOW_BRIGHTNESS, 1.0)[:, None]
        light = np.full(there.shape, -1.0)
        light[there] = painted.mean(axis=1)
        bodies = np.where(there, owner[image.face], -1)
        painted[_outline(bodies, light, image.depth, _MIN_DEPTH_JUMP * self.geometry.extent)[there]] *= _LINE_BRIGHTNESS
        alpha = np.broadcast_to(opacity, there.shape)[there][:, None]
        colour[there] = (1 - alpha) * colour[there] + alpha * painted

    def _shaded(self, world: Array) -> Mask:
        """(k,) whether the arm is above points (k, 3) [m]."""
        camera, image = self._from_above
        seen = camera.project(world)
        at = ((seen[:, :2] - camera.lower) / camera.size * _SHADOW_POINTS).astype(int)
        inside = np.all((at >= 0) & (at < _SHADOW_POINTS), axis=1)
        column, row = np.clip(at, 0, _SHADOW_POINTS - 1).T
        return np.asarray(inside & (image.depth[row, column] > seen[:, 2] + 1e-3 * self.geometry.extent))

    @cached_property
    def _from_above(self) -> tuple[Camera, DepthImage]:
        """The arm seen from straight above, for its shadow."""
        camera = Camera.at(0.0, math.pi / 2).framing(self.geometry.points, 1.0, (0.01, 0.01))
        return camera, DepthImage.of(_faces(self.geometry.solids), camera, (_SHADOW_POINTS, _SHADOW_POINTS))


def grid_step(extent: float) -> float:
    """The round distance of the lines on the floor [m], about a fifth of the arm's extent.

    >>> grid_step(1.2)
    0.2
    """
    power = 10.0 ** math.floor(math.log10(extent / 5))
    return max(step * power for step in (1, 2, 5) if step * power <= extent / 5 * (1 + 1e-9))


def _faces(solids: Sequence[Solid]) -> Array:
    """All faces (k, 4, 3) [m] of some solids."""
    return np.concatenate([np.zeros((0, 4, 3)), *(solid.faces for solid in solids)])


def _outline(bodies: Codes, light: Array, depth: Array, jump: float) -> Mask:
    """(H, W) where one body ends and another or nothing begins, or the depth jumps.

    Surfaces of two bodies that coincide differ in nothing but their owner: no line is drawn between them.
    """
    edge = np.zeros(bodies.shape, dtype=bool)
    finite = np.where(np.isfinite(depth), depth, -1e9)
    for axis in (0, 1):
        first, second = ((slice(None, -1), slice(1, None)) if axis == 0 else
                         ((slice(None), slice(None, -1)), (slice(None), slice(1, None))))  # fmt: skip
        other = (bodies[first] != bodies[second]) & (np.abs(light[first] - light[second]) > _MIN_EDGE_CONTRAST)
        differ = other | (np.abs(finite[first] - finite[second]) > jump)
        edge[first] |= differ & (bodies[first] >= 0)
        edge[second] |= differ & (bodies[second] >= 0)
    return edge


def _rgb(colour: str) -> Array:
    """(3,) red, green and blue from 0 to 1."""
    from matplotlib.colors import to_rgb

    return np.array(to_rgb(colour))
