"""A MoveIt planning scene, ``*.scene``, as obstacles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from posture_opt.collision.obstacles.half_space import HalfSpace
from posture_opt.collision.obstacles.obstacle import Obstacle
from posture_opt.collision.obstacles.solids import Box, Cylinder, Sphere
from posture_opt.errors import InputError, Issue
from posture_opt.files import content, located
from posture_opt.numerics import Array
from posture_opt.robot.robot import xyz_rpy
from posture_opt.texts import one_line

_SIZES = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2, "plane": 4}
"""Shape -> how many numbers it has."""


def scene_obstacles(folder: Path, file: str) -> tuple[Obstacle, ...]:
    """Objects of a planning scene, world; a cone is enclosed by a cylinder; InputError has the line."""
    try:
        text = content(located(folder, file), 10_000_000).decode("utf-8", "replace")  # bytes
        return tuple(_SceneReader(text.splitlines()).obstacles())
    except InputError as error:
        texts = [(f"line {i.line}: {i.message}" if i.line else i.message, i.hint) for i in error.issues]
        raise InputError([Issue(message, ("scene",), file, hint) for message, hint in texts]) from None


@dataclass
class _SceneReader:
    """Reads a scene line by line; ``at`` is the number of the last line, from 1."""

    lines: list[str]
    at: int = 0
    names: list[str] = field(default_factory=list)

    def obstacles(self) -> Iterator[Obstacle]:
        self._line()  # the name of the scene
        while (line := self._line()) != ".":
            if not line.startswith("*"):
                self._fail(f"'{line[:40]}' where an object, '* NAME', or the end, '.', belongs")
            yield from self._object(one_line(line[1:].strip()) or "object")

    def _object(self, name: str) -> Iterator[Obstacle]:
        old = len(self._line().split()) == 1
        self.at -= 1  # which stays to be read
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
        if word == "plane":  # a x + b y + c z + d = 0, solid below
            normal = np.array(sizes[:3])
            if not (size := float(np.linalg.norm(normal))) > 0:
                self._fail(f"the plane '{name}' has no normal")
            up = T[:3, :3] @ normal / size
            offset = f"{float(up @ T[:3, 3]) - sizes[3] / size!r} m"
            return HalfSpace.model_validate(
                {"kind": "half_space", "name": name, "normal": up.tolist(), "offset": offset}
            )
        if min(sizes) <= 0:
            self._fail(f"object '{name}' has a size that is not above zero")
        (xyz, rpy), lengths = xyz_rpy(T), [f"{v!r} m" for v in sizes]
        turned = {"rpy": [f"{v!r} rad" for v in rpy]}
        place: dict[str, Any] = {"name": name, "xyz": [f"{v!r} m" for v in xyz]}
        if word == "box":
            return Box.model_validate({"kind": "box", "size": lengths, **place, **turned})
        if word == "sphere":
            return Sphere.model_validate({"kind": "sphere", "radius": lengths[0], **place})
        sides = {"radius": lengths[0], "length": lengths[1]}
        return Cylinder.model_validate({"kind": "cylinder", **sides, **place, **turned})

    def _unique(self, name: str) -> str:
        fresh, k = name, 2
        while fresh in self.names:
            fresh, k = f"{name} ({k})", k + 1
        self.names.append(fresh)
        return fresh

    def _pose(self) -> Array:
        """(4, 4) position [m] and quaternion (x, y, z, w) of the next two lines."""
        x, y, z = self._numbers(3)
        q = np.array(self._numbers(4))
        if (size := float(np.linalg.norm(q))) < 1e-6:
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
        (value,) = self._numbers(1)
        if value != int(value) or not 0 <= value <= len(self.lines):
            self._fail(f"{value:g} is no number of parts")
        return int(value)

    def _numbers(self, count: int) -> list[float]:
        line = self._line()
        try:
            found = [float(word) for word in line.split()]
        except ValueError:
            found = []
        if len(found) != count or not all(map(math.isfinite, found)):
            self._fail(f"'{line[:40]}' where {count} {'number' if count == 1 else 'numbers'} belong")
        return found

    def _line(self) -> str:
        while self.at < len(self.lines):
            self.at += 1
            if line := self.lines[self.at - 1].strip():
                return line
        self._fail("the file ends in the middle of an object", "is it whole? the last line is a point")
        return ""

    def _fail(self, message: str, hint: str = "") -> None:
        raise InputError(Issue(message, hint=hint, line=self.at))
