"""Obstacle ``mesh``: a part from CAD, an STL, OBJ or PLY file."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field, PrivateAttr

from posture_opt.collision.mesh_boxes import EnclosedMesh, OrientedBox, enclosed_mesh
from posture_opt.collision.mesh_surface import coarser, finer
from posture_opt.collision.obstacles.box import Box
from posture_opt.collision.obstacles.obstacle import PlacedObstacle, Size
from posture_opt.errors import InputError, Issue
from posture_opt.files import located
from posture_opt.numerics import Array
from posture_opt.robot.meshes import UnreadMeshError
from posture_opt.robot.urdf_chain import xyz_rpy

MeshUnit = Literal["m", "cm", "mm", "in"]
"""Unit of the lengths in a mesh file."""
BoxCount = Annotated[int, Field(ge=1, le=64)]
"""So many boxes enclose a mesh at the most."""
DEFAULT_BOXES = 12
_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
_MAX_DRAWN_FACES = 6000
"""Faces of a drawing; of a finer mesh neighbouring corners are drawn as one."""


class Mesh(PlacedObstacle):
    """The solid that a mesh bounds, checked by boxes that enclose it and drawn as it is.

    The distance to the boxes is exact, and never more than that to the mesh.
    """

    summary: ClassVar[str] = "a part from CAD (file: STL, OBJ, PLY; unit), its frame at xyz, turned by rpy"

    kind: Literal["mesh"]
    file: str = Field(description="STL, OBJ, PLY or OFF file, from the folder of the problem file")
    unit: MeshUnit = Field(description="of the lengths in the file, which it does not say itself")
    boxes: BoxCount = Field(DEFAULT_BOXES, description="at most so many boxes enclose it")
    _less: Size = PrivateAttr(0.0)

    def in_folder(self, folder: Path) -> Mesh:
        """The same obstacle with the whole path of its file, which is read.

        Raises:
            InputError: no such file, none that can be read, or trimesh is not installed; by the key.
        """
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
        """The boxes, world."""
        return tuple(Box.model_construct(None, **self._keys(box)).smaller(self._less) for box in self.enclosed.boxes)

    def _keys(self, box: OrientedBox) -> dict[str, Any]:
        """The keys of a box of the mesh in the world, in SI units."""
        size = tuple(float(edge) for edge in box.size)
        place = {"xyz": self._placed(box.middle), "rpy": self._turned(box.rotation)}
        return {"name": self.name, "kind": "box", "size": size, **place}

    def _placed(self, point: Array) -> tuple[Size, ...]:
        """A point (3,) of the mesh [m] in the world; symbols where the mesh is moved by some."""
        return tuple(x + float(d) for x, d in zip(self.xyz, self.rotation @ point, strict=True))

    def _turned(self, rotation: Array) -> tuple[float, ...]:
        """Roll, pitch, yaw [rad] in the world of axes (3, 3) in the frame of the mesh."""
        T = np.eye(4)
        T[:3, :3] = self.rotation @ rotation
        return xyz_rpy(T)[1]

    def smaller(self, by: Size) -> Self:
        """The same with every box smaller by ``by`` [m] on all sides."""
        found = self.model_copy()
        found._less = self._less + by
        return found

    @property
    def half_thickness(self) -> float:
        """Half of the shortest edge of a box [m]."""
        return min(float(box.size.min()) for box in self.enclosed.boxes) / 2

    def distance(self, start: Array, end: Array) -> Array:
        """(...) exact distance of segments (..., 3) to the boxes [m], world; zero where they touch one."""
        return np.asarray(np.min([part.distance(start, end) for part in self.parts], axis=0))

    def extent(self, direction: Array) -> float:
        """Greatest coordinate of the boxes along a unit vector (3,), world [m]."""
        return max(part.extent(direction) for part in self.parts)

    def facets(self, lower: Array, upper: Array) -> Array:
        """(k, 4, 3) the faces of the mesh [m], world; the last corner of each is there twice."""
        placed = finer(coarser(self.enclosed.triangles, _MAX_DRAWN_FACES)) @ self.rotation.T + np.array(
            self.xyz, dtype=float
        )
        return np.concatenate([placed, placed[:, -1:]], axis=1)

    def bounds(self, start: ca.SX, along: ca.SX, length: float, radius: float) -> list[ca.SX]:
        """A smooth lower bound of the distance of a capsule [m] to each box."""
        return [bound for part in self.parts for bound in part.bounds(start, along, length, radius)]
