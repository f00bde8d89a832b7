"""Obstacle ``mesh``: a part from CAD, an STL, OBJ or PLY file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import casadi as ca
import numpy as np
from pydantic import Field, PrivateAttr

from posture_opt.collision.obstacles.obstacle import PlacedObstacle, Size
from posture_opt.collision.obstacles.solids import Box
from posture_opt.errors import InputError, Issue
from posture_opt.files import located
from posture_opt.numerics import TURN, Array, Codes
from posture_opt.robot.meshes import UnreadMeshError, read_triangles
from posture_opt.robot.robot import xyz_rpy

_SURFACE_POINTS = 10_000
"""Points on the surface of the mesh that these are compared with."""
_NEIGHBOURS = 24
"""Of these, the triangles of so many are looked at for each point; of a mesh with fewer faces all."""

Corners = tuple[Array, Array]
"""Least and greatest corner (3,), (3,) of a box along the axes [m]."""


def winding(points: Array, triangles: Array) -> Array:
    """(N,) winding number at points (N, 3): 1 inside (Van Oosterom & Strackee 1983, eq. 8; Jacobson et al. 2013)."""
    coarse = coarser(triangles, 2000)
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
    t = np.linspace(0.0, 1.0, 7)  # points along an edge
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
    """(N,) distance [m] of points (N, 3) to the triangles ``owners`` (m,) of the nearest surface points (m, 3)."""
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


_FLAT_M = 1e-6
"""Corners of a face across an axis differ by less along it."""
_MIN_EDGE_M = 1e-4
"""Shortest edge of a box: flat sheets get this thickness."""


class OrientedBox(NamedTuple):
    """A box in the frame of the mesh."""

    rotation: Array  # (3, 3) R_mesh_box; middle: (3,) [m]; size: (3,) its edges [m]
    middle: Array
    size: Array

    @property
    def volume(self) -> float:
        """Product of the edges [m³]."""
        return float(np.prod(self.size))


@dataclass(frozen=True)
class EnclosedMesh:
    """A mesh and the boxes about it, in the frame of its file."""

    triangles: Array  # (f, 3, 3) corners [m]
    boxes: tuple[OrientedBox, ...]  # which enclose it
    outside: float  # how far the surface of the boxes lies from that of the mesh at most [m]


def enclosed_mesh(path: Path, factor: float, most: int) -> EnclosedMesh:
    """Mesh and at most ``most`` boxes, once a version of the file; ``factor``: its unit [m]; raises UnreadMeshError."""
    status = path.stat()
    return _enclosed(path, factor, most, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=16)
def _enclosed(path: Path, factor: float, most: int, _changed: int, _size: int) -> EnclosedMesh:
    triangles = read_triangles(path) * factor
    frame = _frame(triangles)
    boxes = _boxes(triangles @ frame, most)
    placed = tuple(OrientedBox(frame, frame @ (low + high) / 2, high - low) for low, high in boxes)
    return EnclosedMesh(triangles, placed, gap_between(triangles @ frame, boxes))


def _frame(triangles: Array) -> Array:
    """(3, 3) the axes of the boxes: those of the file, or of the least box about the mesh where it is much less."""
    import trimesh

    points = np.unique(triangles.reshape(-1, 3), axis=0)
    straight = float(np.prod(np.maximum(np.ptp(points, axis=0), _MIN_EDGE_M)))
    try:
        T_box_mesh, extents = trimesh.bounds.oriented_bounds(points)  # type: ignore[no-untyped-call]
    except Exception:  # of Qhull, where all points are in one plane
        return np.eye(3)
    turned = float(np.prod(np.maximum(extents, _MIN_EDGE_M)))
    return np.asarray(T_box_mesh[:3, :3].T) if turned < 0.95 * straight else np.eye(3)


@dataclass(frozen=True)
class _Cell:
    """A part of space between planes along the axes, with the surface in it."""

    low: Array  # low, high: (3,) its corners [m]
    high: Array
    triangles: Array  # (f, 3, 3) of the surface, cut at its faces [m]

    @cached_property
    def weight(self) -> float:
        """Its volume [m³] where it has a surface inside; a cell without one is not cut."""
        return float(np.prod(self.high - self.low)) if len(self.inner) else 0.0

    @cached_property
    def inner(self) -> Array:
        """(k, 3, 3) the triangles that are not on its boundary [m]."""
        at_low = np.all(np.abs(self.triangles - self.low) < _FLAT_M, axis=1)
        at_high = np.all(np.abs(self.triangles - self.high) < _FLAT_M, axis=1)
        return np.asarray(self.triangles[~np.any(at_low | at_high, axis=1)])

    def halves(self) -> tuple[_Cell, _Cell]:
        """Both sides of the largest flat face across an axis inside it, else of the middle of its longest edge."""
        longest = int(np.argmax(self.high - self.low))
        axis, at = self._largest_step() or (longest, float(self.low[longest] + self.high[longest]) / 2)
        below, above = _halves(self.triangles, axis, at)
        between = np.where(np.arange(3) == axis, at, self.high), np.where(np.arange(3) == axis, at, self.low)
        return _Cell(self.low, between[0], below), _Cell(between[1], self.high, above)

    def _largest_step(self) -> tuple[int, float] | None:
        """Axis and place [m] of the largest flat face across an axis that is not on its boundary."""
        found: list[tuple[float, int, float]] = []
        for axis in range(3):
            along = self.triangles[:, :, axis]
            low, high = self.low[axis] + _MIN_EDGE_M / 2, self.high[axis] - _MIN_EDGE_M / 2
            flat = (np.ptp(along, axis=1) < _FLAT_M) & (along[:, 0] > low) & (along[:, 0] < high)
            if not flat.any():
                continue
            corners = self.triangles[flat]
            sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            at, where = np.unique(np.round(along[flat, 0] / _FLAT_M), return_inverse=True)
            area = np.bincount(where, np.linalg.norm(sides, axis=1), len(at))
            found.append((float(area.max()), axis, float(at[np.argmax(area)] * _FLAT_M)))
        return max(found)[1:] if found else None

    @property
    def corners(self) -> Array:
        """(8, 3) [m]."""
        return self.low + _CORNERS * (self.high - self.low)


_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=float)


def _boxes(triangles: Array, most: int) -> list[Corners]:
    """At most ``most`` boxes along the axes about the solid that triangles (f, 3, 3) bound [m]."""
    # What a cell holds of the solid lies in the box about its surface and those of its corners that are inside; a cell
    # without surface is inside as a whole, or empty.
    cells = [_Cell(*_corners(triangles), triangles)]
    while len(cells) < 250:
        cells.sort(key=lambda cell: cell.weight)
        if cells[-1].weight == 0 or float(np.max(cells[-1].high - cells[-1].low)) < 2 * _MIN_EDGE_M:
            break
        cells += cells.pop().halves()
    # A corner on the surface counts where it is inside as seen from the cell: moved a little to its middle.
    nudged = [cell.corners + 1e-3 * ((cell.low + cell.high) / 2 - cell.corners) for cell in cells]
    inside = winding(np.concatenate(nudged), triangles).reshape(-1, 8) > 0.5
    middles = winding(np.array([(cell.low + cell.high) / 2 for cell in cells]), triangles) > 0.5
    held = []
    for cell, within, middle in zip(cells, inside, middles, strict=True):
        if len(cell.inner):
            held.append(_corners(np.concatenate([cell.inner.reshape(-1, 3), cell.corners[within]])))
        elif middle:
            held.append((cell.low, cell.high))
    return _merged(held, most)


def _merged(boxes: list[Corners], most: int) -> list[Corners]:
    low, high = (np.array(side) for side in zip(*boxes, strict=True))
    while len(low) > 1:
        volume = np.prod(high - low, axis=1)
        union = np.prod(np.maximum(high[:, None], high) - np.minimum(low[:, None], low), axis=2)
        more = union - volume[:, None] - volume
        np.fill_diagonal(more, np.inf)
        i, j = np.unravel_index(int(np.argmin(more)), more.shape)
        if len(low) <= most and more[i, j] > 2e-3 * union[i, j]:  # less than this share of their volume is free
            break
        joined = np.minimum(low[i], low[j]), np.maximum(high[i], high[j])
        kept = ~np.all((low >= joined[0] - 1e-12) & (high <= joined[1] + 1e-12), axis=1)
        low, high = (np.vstack([side[kept], end]) for side, end in zip((low, high), joined, strict=True))
    return list(zip(low, high, strict=True))


def _halves(triangles: Array, axis: int, at: float) -> tuple[Array, Array]:
    beyond = triangles[:, :, axis] - at
    below, above = np.all(beyond <= 0, axis=1), np.all(beyond >= 0, axis=1)
    cut = [*_cut(triangles[~below & ~above], axis, at)]
    lower = [triangles[below], *(part for part, side in cut if side < 0)]
    upper = [triangles[above], *(part for part, side in cut if side > 0)]
    none = np.zeros((0, 3, 3))
    return np.concatenate([none, *lower]), np.concatenate([none, *upper])


def _cut(triangles: Array, axis: int, at: float) -> Iterator[tuple[Array, int]]:
    """Triangles (k, 3, 3) on a side of a plane that they cross, with the side: the one alone, and the two others."""
    for triangle in triangles:
        beyond = triangle[:, axis] - at
        for side in (-1, 1):
            corners: list[Array] = []
            for k in range(3):
                a, b = triangle[k], triangle[(k + 1) % 3]
                da, db = side * beyond[k], side * beyond[(k + 1) % 3]
                corners += [a] if da >= 0 else []
                corners += [a + da / (da - db) * (b - a)] if da * db < 0 else []
            fans = [[corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1)]
            if fans:
                yield np.array(fans), side


def _corners(points: Array) -> Corners:
    """The box along the axes about points (..., 3) [m], its edges no shorter than `_MIN_EDGE_M`."""
    flat = points.reshape(-1, 3)
    low, high = flat.min(axis=0), flat.max(axis=0)
    more = np.maximum(_MIN_EDGE_M - (high - low), 0.0) / 2
    return low - more, high + more


MeshUnit = Literal["m", "cm", "mm", "in"]
"""Unit of the lengths in a mesh file."""
BoxCount = Annotated[int, Field(ge=1, le=64)]
"""So many boxes enclose a mesh at the most."""
DEFAULT_BOXES = 12
_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}


class Mesh(PlacedObstacle):
    """A solid bounded by a mesh, drawn as it is; distances are exact to boxes that enclose it."""

    summary: ClassVar[str] = "a part from CAD (file: STL, OBJ, PLY; unit), its frame at xyz, turned by rpy"

    kind: Literal["mesh"]
    file: str = Field(description="STL, OBJ, PLY or OFF file, from the folder of the problem file")
    unit: MeshUnit = Field(description="of the lengths in the file, which it does not say itself")
    boxes: BoxCount = Field(DEFAULT_BOXES, description="at most so many boxes enclose it")
    _less: Size = PrivateAttr(0.0)

    def in_folder(self, folder: Path) -> Mesh:
        """The mesh with the whole path of its file, which is read; InputError names the key."""
        try:
            found = self.model_copy(update={"file": str(located(folder, self.file))})
            if not Path(found.file).is_file():
                raise InputError(Issue(f"no such file (in {folder.absolute()})", ("file",), self.file))
            assert found.enclosed.boxes
        except UnreadMeshError as reason:
            raise InputError(Issue(str(reason), ("file",), self.file)) from None
        except InputError as error:
            raise InputError([issue if issue.key else issue.at("file") for issue in error.issues]) from None
        return found

    @cached_property
    def enclosed(self) -> EnclosedMesh:
        """The mesh and its boxes, in the frame of the file."""
        return enclosed_mesh(Path(self.file), _UNITS[self.unit], self.boxes)

    @property
    def note(self) -> str:
        """How the mesh is checked, in a sentence."""
        count = len(self.enclosed.boxes)
        return (
            f"{self.name} ({Path(self.file).name}, {len(self.enclosed.triangles)} faces) is checked by "
            f"{count} {'box' if count == 1 else 'boxes'} about it, at most {1e3 * self.enclosed.outside:.1f} mm outside"
        )

    @property
    def parts(self) -> tuple[Box, ...]:
        """The boxes, world; their middles are symbols where the mesh is moved by some."""
        found = []
        for box in self.enclosed.boxes:
            T = np.eye(4)
            T[:3, :3] = self.rotation @ box.rotation
            xyz = tuple(x + float(d) for x, d in zip(self.xyz, self.rotation @ box.middle, strict=True))
            size: Any = tuple(float(edge) for edge in box.size)
            keys = {"name": self.name, "kind": "box", "size": size, "xyz": xyz, "rpy": xyz_rpy(T)[1]}
            found.append(Box.model_construct(None, **keys).smaller(self._less))
        return tuple(found)

    def smaller(self, by: Size) -> Self:
        found = self.model_copy()
        found._less = self._less + by
        return found

    @property
    def half_thickness(self) -> float:
        return min(float(box.size.min()) for box in self.enclosed.boxes) / 2

    def distance(self, start: Array, end: Array) -> Array:
        return np.asarray(np.min([part.distance(start, end) for part in self.parts], axis=0))

    def extent(self, direction: Array) -> float:
        return max(part.extent(direction) for part in self.parts)

    def facets(self, lower: Array, upper: Array) -> Array:
        """(k, 4, 3) faces of the mesh [m], world; the last corner of each is there twice."""
        drawn = finer(coarser(self.enclosed.triangles, 6000))
        placed = drawn @ self.rotation.T + np.array(self.xyz, dtype=float)
        return np.concatenate([placed, placed[:, -1:]], axis=1)

    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        return [bound for part in self.parts for bound in part.bounds(start, along, length, radius)]
