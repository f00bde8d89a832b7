"""The solid arm and what stands around it, drawn as shaded faces."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.collision.facets import capsule_facets
from posture_opt.collision.placed_capsules import PlacedCapsules
from posture_opt.numerics import Array, Mask
from posture_opt.report.style import BLUE, GREEN, GREY, VERMILLION
from posture_opt.robot.shape import BASE, TOOL, Capsule

if TYPE_CHECKING:
    from posture_opt.collision.scene import Scene
    from posture_opt.robot.robot import Robot

_LIGHT = (0.45, 0.55, 0.75)  # towards the viewer, to his left, up
_DARK = 0.5  # of the colour where no light falls
_AROUND = 0.35  # of the arm's size: so far around it obstacles are drawn
_CLEAR = 0.22  # opacity of obstacles


@dataclass(frozen=True)
class Bodies:
    """Faces (k, 4, 3) [mm] with their colours (k, 4) RGBA and outward normals (k, 3)."""

    faces: Array
    colours: Array

    @classmethod
    def of_arm(cls, robot: Robot, q: Sequence[float]) -> Bodies:
        """The capsules of the arm at a posture (n,): links in two shades in turn, base grey, tool green."""
        starts, ends = PlacedCapsules(robot, robot.shape).segments(np.array([q], dtype=float))
        faces: list[Array] = []
        colours: list[Array] = []
        for start, end, capsule in zip(starts[0], ends[0], robot.shape, strict=True):
            found = 1e3 * capsule_facets(start, end, capsule.radius)
            found = found[_outside(found, len(faces), 1e3 * starts[0], 1e3 * ends[0], robot.shape)]
            faces.append(found)
            colours.append(np.tile(_colour(robot, capsule.joint), (len(found), 1)))
        return cls(np.concatenate(faces), np.concatenate(colours))

    @classmethod
    def of_obstacles(cls, seen: Mapping[str, Array]) -> Bodies | None:
        """Obstacles by name, their faces (k, 4, 3) [mm]; translucent. None where there are none."""
        faces = np.concatenate([np.zeros((0, 4, 3)), *seen.values()])
        return cls(faces, np.tile((*_rgb(VERMILLION), _CLEAR), (len(faces), 1))) if len(faces) else None

    def draw(self, axes: Any, elevation: float, azimuth: float, zorder: float) -> None:
        """Adds the faces, those in front last, lit from the upper left of a viewer at these angles [deg]."""
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        back, left, up = _view(elevation, azimuth)
        light = _LIGHT[0] * back + _LIGHT[1] * left + _LIGHT[2] * up
        normals = _normals(self.faces)
        seen = (self.colours[:, 3] < 1) | (normals @ back > -0.1)
        shade = _DARK + (1 - _DARK) * np.clip(normals @ light / np.linalg.norm(light), 0.0, 1.0)
        colours = np.column_stack([self.colours[:, :3] * shade[:, None], self.colours[:, 3]])[seen]
        opaque = self.colours[:, 3].min() == 1
        edges = colours if opaque else "none"  # closes the seams between faces
        axes.add_collection3d(
            Poly3DCollection(self.faces[seen], facecolors=colours, edgecolors=edges, linewidths=0.3, zorder=zorder)
        )


def obstacles_near(scene: Scene, points: Array) -> dict[str, Array]:
    """Name -> faces (k, 4, 3) [mm] of the obstacles near an arm with points (k, 3); of large ones what is near."""
    low, high = points.min(axis=0), points.max(axis=0)
    size = float((high - low).max())
    low, high = low - _AROUND * size, high + _AROUND * size
    found = {}
    for obstacle in scene.obstacles:
        faces = 1e3 * obstacle.facets(low / 1e3, high / 1e3)
        near = _inside(faces, low, high)
        small = near.any() and float(np.ptp(faces.reshape(-1, 3), axis=0).max()) < size
        if near.any():
            found[obstacle.name] = faces if small else faces[near]
    return found


def label_obstacles(axes: Any, seen: Mapping[str, Array], arm: Array) -> None:
    """Each name at the upper part of its obstacle, where it is farthest from the arm (k, 3) and from other names."""
    from mpl_toolkits.mplot3d import proj3d

    def projected(points: Array) -> Array:
        x, y, _ = proj3d.proj_transform(*points.T, axes.get_proj())
        return np.column_stack([x, y])

    taken = projected(arm)
    for name, faces in seen.items():
        points = np.unique(faces.reshape(-1, 3), axis=0)
        points = points[points[:, 2] >= points[:, 2].max() - 0.2 * np.ptp(points[:, 2])]
        places = projected(points)
        apart = np.linalg.norm(places[:, None] - taken, axis=2).min(axis=1)
        k = int(np.argmax(apart))
        taken = np.vstack([taken, places[k]])
        axes.text(*points[k], name, color=_darker(VERMILLION), ha="center", va="bottom", zorder=9)


def _inside(faces: Array, low: Array, high: Array) -> Mask:
    middle = faces.mean(axis=1)
    return np.asarray(np.all((middle >= low) & (middle <= high), axis=1))


def _outside(faces: Array, own: int, starts: Array, ends: Array, shape: Sequence[Capsule]) -> Mask:
    """(k,) which faces of one capsule are not wholly inside another; of two that coincide one is kept."""
    kept, points = np.ones(len(faces), dtype=bool), faces.reshape(-1, 3)
    for k, (start, end, capsule) in enumerate(zip(starts, ends, shape, strict=True)):
        if k != own:
            along = end - start
            t = np.clip((points - start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
            apart = np.linalg.norm(points - start - t[:, None] * along, axis=1).reshape(-1, 4).max(axis=1)
            kept &= apart > 1e3 * capsule.radius * (1.001 if k < own else 0.99)
    return kept


def _colour(robot: Robot, joint: str) -> tuple[float, float, float, float]:
    if joint in (BASE, TOOL):
        return (*_rgb(GREY if joint == BASE else GREEN), 1.0)
    blue = np.array(_rgb(BLUE))
    lighter = 0.45 if robot.joint_names.index(joint) % 2 else 0.15
    r, g, b = (blue + lighter * (1 - blue)).tolist()
    return r, g, b, 1.0


def _normals(faces: Array) -> Array:
    across, along = faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1]
    normals = np.cross(along, across)
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(size > 0, size, 1.0))


def _view(elevation: float, azimuth: float) -> tuple[Array, Array, Array]:
    """Unit vectors from the scene to the viewer, to his left, and up as he sees it."""
    e, a = math.radians(elevation), math.radians(azimuth)
    back = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
    left = np.array([math.sin(a), -math.cos(a), 0.0])
    return back, left, np.cross(back, -left)


def _rgb(colour: str) -> tuple[float, float, float]:
    r, g, b = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return r, g, b


def _darker(colour: str) -> tuple[float, float, float]:
    r, g, b = (0.7 * part for part in _rgb(colour))
    return r, g, b
