"""Obstacle ``mesh``: a part from CAD, an STL, OBJ or PLY file."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field, PrivateAttr

from posture_opt.collision.mesh_boxes import EnclosedMesh, coarser, enclosed_mesh, finer
from posture_opt.collision.obstacles.box import Box
from posture_opt.collision.obstacles.obstacle import PlacedObstacle, Size
from posture_opt.errors import InputError, Issue
from posture_opt.files import located
from posture_opt.numerics import Array
from posture_opt.robot.meshes import UnreadMeshError
from posture_opt.robot.robot import xyz_rpy

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
