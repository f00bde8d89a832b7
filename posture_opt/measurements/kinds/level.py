"""An inclinometer on the tool: the angles of its two axes against the horizon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import permutations, product
from typing import ClassVar

import numpy as np

from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, Vector, dot, tool_pose
from posture_opt.measurements.rotations import nearest_rotation, turned_by
from posture_opt.numerics import Array, Codes, Mask


@dataclass(frozen=True, eq=False)
class Level(Kind):
    """``h = (asin(s_x · z), asin(s_y · z))`` with z the vertical and s the axes of the inclinometer in the world.

    ``s = R_world_tool M₀ Rz(c) Ry(b) Rx(a)`` with M₀ the mounting on the tool that suits the nominal arm, and a, b, c
    small. Neither lengths nor a turn about the vertical are seen. Errors are angles: 1 mrad is 1 mm at a lever of 1 m.
    """

    kind: ClassVar[str] = "level"
    noun: ClassVar[str] = "readings of a level"
    unit: ClassVar[str] = "rad"
    columns: ClassVar[Mapping[str, str]] = {"level_x": "angle", "level_y": "angle"}
    example: ClassVar[str] = "level_x [deg] and level_y [deg] for an inclinometer"
    sigma_key: ClassVar[str] = "level"
    fixed_to_base: ClassVar[bool] = False
    error_words: ClassVar[str] = "error of the level at 1 m"
    number_words: ClassVar[str] = "angle, at a lever of 1 m"
    axis_names: ClassVar[tuple[str, ...]] = ("level_x", "level_y")
    blind_spot: ClassVar[str] = "a level sees neither lengths nor a turn about the vertical"
    remedy: ClassVar[str] = "for these, measure positions, distances or touches of planes too"

    up: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # (3,) the vertical z, world
    mounting: Array = field(default_factory=lambda: np.eye(3))  # (3, 3) the reference M₀
    # (m, 3, 3) another one that suits the nominal arm about as well: where the tool hardly tilts, as on a SCARA, two
    # numbers do not show whether the level is upside down
    others: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> Level:
        best, *others = _mountings(up @ tool_pose(seen)[0], np.sin(seen.reading[:, :2]))
        return replace(self, up=up, mounting=best, others=np.array(others).reshape(-1, 3, 3))

    def alternatives(self, seen: Seen) -> Sequence[tuple[Kind, Codes]]:
        kinds = [replace(self, mounting=other, others=self.mounting[None]) for other in self.others]
        return [(kind, np.arange(len(seen.place))) for kind in kinds]

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        return (("roll", "rad"), ("pitch", "rad"), ("yaw", "rad"))

    def error(self, seen: Seen) -> Slots:
        """``asin(s · z) − m``."""
        height = self.up @ _axes(self, seen)
        return tuple(np.arcsin(np.clip(height[:, i], -1, 1)) - seen.reading[:, i] for i in range(2))

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """``ω · (s × z) / cos h``."""
        s = _axes(self, seen)
        across, height = np.cross(s, self.up, axisa=1, axisb=0, axisc=1), self.up @ s
        return tuple(dot(turn, across[:, :, i].T) / _cosine(height[:, i]) for i in range(2))

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """``(∂s/∂a · z) / cos h``."""
        height, moved = self.up @ _axes(self, seen), self.up @ _axes(self, seen, axis)
        return tuple(moved[:, i] / _cosine(height[:, i]) for i in range(2))

    def aspect(self, seen: Seen) -> Array:
        """Both angles [rad], and whether it is upright (1) or upside down (−1)."""
        height = np.clip(self.up @ _axes(self, seen), -1, 1)
        return np.column_stack([np.arcsin(height[:, :2]), np.where(height[:, 2] < 0, -1.0, 1.0)])

    def bounds(self, place: int, given: Array) -> tuple[Array, Array]:
        most = np.abs(given[:, :2]).max(axis=0)
        sides = given[:, 2]
        return np.r_[-most, sides.min()], np.r_[most, sides.max()]

    def expected(self, seen: Seen) -> Array:
        """Both angles [rad]."""
        return self.aspect(seen) * [1.0, 1.0, 0.0]


@lru_cache(maxsize=8)
def _axes(kind: Level, seen: Seen, by: int | None = None) -> Array:
    """(N, 3, 3) the axes of the inclinometer in the world as columns, or their derivative by one of the turns."""
    return np.asarray(tool_pose(seen)[0] @ kind.mounting @ turned_by(seen.values[:, :3], by))


def _cosine(height: Array) -> Array:
    """(N,) the cosine of the angle whose sine is the ``height`` of an axis, not zero for an upright one."""
    return np.asarray(np.sqrt(np.maximum(1 - height**2, 1e-12)))


def _mountings(up: Array, heights: Array) -> list[Array]:
    """(3, 3) M with ``Mᵀ up ≈ (heights, ±√(1 − |heights|²))``, by Kabsch from 24 starts."""
    # up: (N, 3) the vertical in the frame of the tool; heights: (N, 2) of both axes of the inclinometer
    third = np.sqrt(np.maximum(1 - np.sum(heights**2, axis=1), 0.0))

    def improved(M: Array) -> tuple[float, Array]:
        for _ in range(8):  # three are enough
            M = nearest_rotation(up.T @ np.column_stack([heights, np.where(up @ M[:, 2] < 0, -third, third)]))
        return float(np.sum((up @ M[:, :2] - heights) ** 2)), M

    axes = [np.eye(3)[list(p)] * signs for p in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)]
    found = sorted((improved(M) for M in axes if np.linalg.det(M) > 0), key=lambda one: one[0])
    (least, best), sides = found[0], np.sign(up @ found[0][1][:, 2])
    # Up to ten times the least sum of squares a mounting suits the nominal arm about as well: its errors decide.
    others = [M for cost, M in found if cost <= 10 * least and np.mean(np.sign(up @ M[:, 2]) * sides) < 0]
    return [best, *others[:1]]
