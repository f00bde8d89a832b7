"""A MoveIt planning scene, ``*.scene``, as obstacles.

Each object is ``* NAME``, its pose since MoveIt 1.1 (position, then a quaternion x y z w), the number of shapes, and
for each a word, its sizes, its pose and a colour; then the number of its subframes since MoveIt 1.1, with a name and a
pose each. A line ``.`` ends the file. Lengths in m.
Source: MoveIt, planning_scene.cpp (saveGeometryToStream), geometric_shapes, shape_operations.cpp (saveAsText).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from posture_opt.collision.obstacles.box import Box
from posture_opt.collision.obstacles.cylinder import Cylinder
from posture_opt.collision.obstacles.half_space import HalfSpace
from posture_opt.collision.obstacles.obstacle import Obstacle
from posture_opt.collision.obstacles.sphere import Sphere
from posture_opt.errors import InputError, Issue
from posture_opt.files import content, located
from posture_opt.numerics import Array
from posture_opt.robot.urdf_chain import xyz_rpy
from posture_opt.texts import one_line

_MAX_BYTES = 10_000_000
_SIZES = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2, "plane": 4}
"""Shape -> how many numbers it has."""
_MIN_QUATERNION = 1e-6


def scene_obstacles(folder: Path, file: str) -> tuple[Obstacle, ...]:
    """The objects of a planning scene in the world; a cone is enclosed by a cylinder.

    Raises:
        InputError: no such file, no planning scene, or meshes in it; with the line, under the key ``scene``.
    """
    try:
        text = content(located(folder, file), _MAX_BYTES).decode("utf-8", "replace")
        return tuple(_SceneReader(text.splitlines()).obstacles())
    except InputError as error:
        raise InputError(
            [
                Issue(f"line {i.line}: {i.message}" if i.line else i.message, ("scene",), file, i.hint)
                for i in error.issues
            ]
        ) from None


@dataclass
class _SceneReader:
    """Reads a scene line by line; ``at`` is the number of the last line, from 1."""

    lines: list[str]
    at: int = 0
    names: list[str] = field(default_factory=list)

    def obstacles(self) -> Iterator[Obstacle]:
        """Every shape of every object."""
        self._line()  # the name of the scene
        while (line := self._line()) != ".":
            if not line.startswith("*"):
                self._fail(f"'{line[:40]}' where an object, '* NAME', or the end, '.', belongs")
            yield from self._object(one_line(line[1:].strip()) or "object")

    def _object(self, name: str) -> Iterator[Obstacle]:
        """The shapes of one object."""
        old = len(self._peek().split()) == 1
        T = np.eye(4) if old else self._pose()
        count = self._count()
        for k in range(count):
            word = self._line()
            if word not in _SIZES:
                hint = "save it as an STL file and state it as an obstacle of kind mesh" if word == "mesh" else ""
                self._fail(f"object '{name}' has a shape '{word[:20]}'", hint or f"known are {', '.join(_SIZES)}")
            sizes = self._numbers(_SIZES[word])
            placed = T @ self._pose()
            self._numbers(4)  # its colour
            yield self._obstacle(self._unique(name if count == 1 else f"{name} {k + 1}"), word, sizes, placed)
        for _ in range(0 if old else self._count()):
            self._line()  # the name of a subframe
            self._pose()

    def _obstacle(self, name: str, word: str, sizes: list[float], T: Array) -> Obstacle:
        """One shape in the world, T (4, 4) [m]."""
        xyz, rpy = xyz_rpy(T)
        place: dict[str, Any] = {"name": name, "xyz": [f"{v!r} m" for v in xyz], "rpy": [f"{v!r} rad" for v in rpy]}
        lengths = [f"{v!r} m" for v in sizes]
        if word != "plane" and min(sizes) <= 0:
            self._fail(f"object '{name}' has a size that is not above zero")
        if word == "box":
            return Box.model_validate({"kind": "box", "size": lengths, **place})
        if word == "sphere":
            place.pop("rpy")
            return Sphere.model_validate({"kind": "sphere", "radius": lengths[0], **place})
        if word == "plane":  # a x + b y + c z + d = 0, solid below
            normal = np.array(sizes[:3])
            if not (size := float(np.linalg.norm(normal))) > 0:
                self._fail(f"the plane '{name}' has no normal")
            up = T[:3, :3] @ normal / size
            offset = float(up @ T[:3, 3]) - sizes[3] / size
            return HalfSpace.model_validate(
                {"kind": "half_space", "name": name, "normal": up.tolist(), "offset": f"{offset!r} m"}
            )
        return Cylinder.model_validate({"kind": "cylinder", "radius": lengths[0], "length": lengths[1], **place})

    def _unique(self, name: str) -> str:
        """The name, numbered where another object has it."""
        fresh, k = name, 2
        while fresh in self.names:
            fresh, k = f"{name} ({k})", k + 1
        self.names.append(fresh)
        return fresh

    def _pose(self) -> Array:
        """(4, 4) position [m] and quaternion (x, y, z, w) of the next two lines."""
        x, y, z = self._numbers(3)
        q = np.array(self._numbers(4))
        if (size := float(np.linalg.norm(q))) < _MIN_QUATERNION:
            self._fail("a quaternion of length zero is no orientation")
        a, b, c, w = q / size
        T = np.eye(4)
        T[:3, :3] = [
            [1 - 2 * (b * b + c * c), 2 * (a * b - w * c), 2 * (a * c + w * b)],
            [2 * (a * b + w * c), 1 - 2 * (a * a + c * c), 2 * (b * c - w * a)],
            [2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)],
        ]
        T[:3, 3] = x, y, z
        return T

    def _count(self) -> int:
        """A number of parts."""
        (value,) = self._numbers(1)
        if value != int(value) or not 0 <= value <= len(self.lines):
            self._fail(f"{value:g} is no number of parts")
        return int(value)

    def _numbers(self, count: int) -> list[float]:
        """The finite numbers of the next line."""
        line = self._line()
        try:
            found = [float(word) for word in line.split()]
        except ValueError:
            found = []
        if len(found) != count or not all(map(math.isfinite, found)):
            self._fail(f"'{line[:40]}' where {count} {'number' if count == 1 else 'numbers'} belong")
        return found

    def _peek(self) -> str:
        """The line behind the last one, which stays to be read."""
        line = self._line()
        self.at -= 1
        return line

    def _line(self) -> str:
        """The next line that is not empty.

        Raises:
            InputError: the file has ended.
        """
        while self.at < len(self.lines):
            self.at += 1
            if line := self.lines[self.at - 1].strip():
                return line
        self._fail("the file ends in the middle of an object", "is it whole? the last line is a point")
        return ""

    def _fail(self, message: str, hint: str = "") -> None:
        """Refuse the file.

        Raises:
            InputError: always, with the line.
        """
        raise InputError(Issue(message, hint=hint, line=self.at))
