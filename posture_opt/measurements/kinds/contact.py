"""Touches of unknown points and planes: sockets, centre marks, a table, a granite."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, Vector, dot, stacked
from posture_opt.numerics import Array, Json, Mask
from posture_opt.spec import Spec
from posture_opt.units import Length


@dataclass(frozen=True, eq=False)
class PointContact(Kind):
    """``0 = p − c`` with c the unknown point: three numbers a touch, and no instrument."""

    kind: ClassVar[str] = "point"
    noun: ClassVar[str] = "touched points"
    label: ClassVar[str] = "point"
    example: ClassVar[str] = "point for touched points"
    size_known: ClassVar[bool] = False
    contact: ClassVar[bool] = True
    about_mean: ClassVar[bool] = True
    remedy: ClassVar[str] = "state a distance under data.distances"
    held_out_by: ClassVar[Literal["pose", "place"]] = "place"

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        return (("x", "m"), ("y", "m"), ("z", "m"))

    def touched_points(self, names: Sequence[str]) -> Mapping[str, int]:
        return {name: code for code, name in enumerate(names)}

    def start(self, seen: Seen, places: int) -> Array:
        points = stacked(seen.position, len(seen.place))
        found = np.zeros((places, 3))
        for k in np.unique(seen.place):
            found[k] = points[seen.place == k].mean(axis=0)
        return found

    def error(self, seen: Seen) -> Slots:
        """``p − c``."""
        return tuple(seen.position[a] - seen.values[:, a] for a in range(3))

    def aspect(self, seen: Seen) -> Array:
        """The tool's z axis in the world: from where the ball goes into the socket."""
        return stacked(seen.columns[2], len(seen.place))

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """``−e_axis``."""
        return tuple(-1.0 if a == axis else 0.0 for a in range(3))


class PlaneSpec(Spec):
    """What is known of a touched plane beforehand."""

    radius: Length = Field(0.0, ge=0, description="of the ball whose centre is the tool point")
    flatness: Length = Field(0.0, ge=0, description="standard deviation of the surface from a plane")


@dataclass(frozen=True, eq=False)
class PlaneContact(Kind):
    """``0 = n·(p − c) − h``: the ball's centre p is at one distance from the surface at every touch.

    The unit normal is ``n = (n₀ + a e₁ + b e₂)/√(1 + a² + b²)``; c and the axes (e₁, e₂, n₀) are those of a plane
    through the nominal tool points, so that a, b, h are small. The ball counts on one side: its radius only shifts the
    surface that is reported. Source: Zhuang, Motaghedi, Roth (1999), plane constraints.
    """

    kind: ClassVar[str] = "plane"
    noun: ClassVar[str] = "touches of planes"
    label: ClassVar[str] = "plane"
    example: ClassVar[str] = "plane for touched planes"
    sigma_key: ClassVar[str] = "plane"
    settings: ClassVar[str] = "planes"
    size_known: ClassVar[bool] = False
    contact: ClassVar[bool] = True
    error_words: ClassVar[str] = "error across the plane"
    number_words: ClassVar[str] = "row"
    axis_names: ClassVar[tuple[str, ...]] = ("across the plane",)
    blind_spot: ClassVar[str] = "planes give no scale across them: an arm of another size touches other planes as well"
    remedy: ClassVar[str] = "add one known length: give a link its measured value in the file"

    frames: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))  # (P, 3, 3) the rows (e₁, e₂, n₀) [1]
    centres: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (P, 3) c [m], world
    # (P,) +1 or −1, the side of the surface on which the base of the arm is
    sides: Array = field(default_factory=lambda: np.zeros(0))

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> PlaneContact:
        points, count = stacked(seen.position, len(seen.place)), len(self.names)
        frames, centres = np.zeros((count, 3, 3)), np.zeros((count, 3))
        basis = np.eye(3)[moving] if moving.any() else np.eye(3)
        for k in range(count):
            own = points[seen.place == k]
            centres[k] = own.mean(axis=0)
            normal = np.linalg.svd((own - centres[k]) @ basis.T)[2][-1] @ basis
            first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
            first /= np.linalg.norm(first)
            frames[k] = first, np.cross(normal, first), normal
        toward = np.einsum("ki,ki->k", points.mean(axis=0) - centres, frames[:, 2])
        return replace(self, frames=frames, centres=centres, sides=np.where(toward < 0, -1.0, 1.0))

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        return (("tilt_1", "rad"), ("tilt_2", "rad"), ("offset", "m"))

    def error(self, seen: Seen) -> Slots:
        """``n·(p − c) − h``."""
        n, from_centre, _ = self._at(seen)
        return (dot(n, from_centre) - seen.values[:, 2],)

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """``n·v``."""
        return (dot(self._at(seen)[0], shift),)

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """``(e − (n·e) n)·(p − c)/√(1 + a² + b²)`` for a turn toward e, −1 for the distance."""
        if axis == 2:
            return (-1.0,)
        n, from_centre, length = self._at(seen)
        e = self.frames[seen.place, axis].T
        return ((dot(e, from_centre) - dot(n, e) * dot(n, from_centre)) / length,)

    def _at(self, seen: Seen) -> tuple[Vector, Vector, Any]:
        """The normals n and ``p − c``, three of (N,) each, and ``√(1 + a² + b²)``."""
        a, b = seen.values[:, 0], seen.values[:, 1]
        length = np.sqrt(1 + a**2 + b**2)
        first, second, normal = np.moveaxis(self.frames[seen.place], 1, 0)
        n = ((normal + a[:, None] * first + b[:, None] * second) / length[:, None]).T
        return n, [seen.position[i] - self.centres[seen.place, i] for i in range(3)], length

    def aspect(self, seen: Seen) -> Array:
        """How steeply the tool's z axis meets the surface (cosine), and where on it the ball touches [m]."""
        n, from_centre, _ = self._at(seen)
        steepness = -self.sides[seen.place] * dot(n, seen.columns[2])
        first, second, _ = np.moveaxis(self.frames[seen.place], 1, 0)
        return np.stack([steepness, dot(first.T, from_centre), dot(second.T, from_centre)], axis=1)

    def sigma_of(self, place: str, stated: float) -> float:
        """``√(σ² + flatness²)``."""
        return hypot(stated, self.stated[place].flatness) if place in self.stated else stated

    def described(self, place: str, values: Array) -> dict[str, Json]:
        """Unit normal toward the arm, and the distance of the surface from the world's origin along it [m]."""
        k = list(self.names).index(place)
        first, second, normal = self.frames[k]
        n = normal + values[0] * first + values[1] * second
        n = self.sides[k] * n / np.linalg.norm(n)
        radius = self.stated[place].radius if place in self.stated else 0.0
        distance = float(n @ self.centres[k] + self.sides[k] * values[2] - radius)
        return {"normal": [float(v) for v in n], "distance": distance}
