"""Position of the tool point, as a tracker measures it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, Vector, stacked
from posture_opt.measurements.rotations import roll_pitch_yaw, turned_by
from posture_opt.numerics import Array, Codes, Json, Mask


@dataclass(frozen=True, eq=False)
class Position(Kind):
    """``h = p``, the measured coordinates of the tool point."""

    kind: ClassVar[str] = "position"
    noun: ClassVar[str] = "positions"
    fixed_to_base: ClassVar[bool] = False
    leaves_geometry_open: ClassVar[bool] = False
    example: ClassVar[str] = "x [mm], y [mm], z [mm]"

    def axes(self, measured: Mask) -> Codes:
        """The coordinates that were measured."""
        return np.flatnonzero(measured)

    def error(self, seen: Seen) -> Slots:
        """``p − m``, in all three coordinates: those that were not measured hold the nominal model's value."""
        return tuple(seen.position[a] - seen.reading[:, a] for a in range(3))

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """The shift itself."""
        return tuple(shift)


@dataclass(frozen=True, eq=False)
class FramedPosition(Kind):
    """``p = t₀ + d + R₀ Rz Ry Rx m``: positions m that a tracker measures in a frame of its own, beside other readings.

    The frame (R₀, t₀) is the one that brings m to the nominal tool points; d and the turns are small unknowns. Errors
    are in the axes of the world.

    Args:
        frame: (4, 4) T_world_tracker that suits the nominal arm.
    """

    kind: ClassVar[str] = "position"
    noun: ClassVar[str] = "positions"

    frame: Array = field(default_factory=lambda: np.eye(4))

    def axes(self, measured: Mask) -> Codes:
        """All three coordinates."""
        return np.arange(3)

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> FramedPosition:
        """The frame that suits the nominal arm best. Source: Umeyama (1991), without scale."""
        p, m = stacked(seen.position, len(seen.place)), seen.reading[:, :3]
        U, _, Vt = np.linalg.svd((p - p.mean(axis=0)).T @ (m - m.mean(axis=0)))
        T = np.eye(4)
        T[:3, :3] = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        T[:3, 3] = p.mean(axis=0) - T[:3, :3] @ m.mean(axis=0)
        return replace(self, frame=T)

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        """The pose of the frame, about the reference."""
        return (("x", "m"), ("y", "m"), ("z", "m"), ("roll", "rad"), ("pitch", "rad"), ("yaw", "rad"))

    def start(self, seen: Seen, places: int) -> Array:
        """Zeros: the reference suits the nominal arm."""
        return np.zeros((places, 6))

    def error(self, seen: Seen) -> Slots:
        """``p − T m``."""
        there = self._turned(seen) + self.frame[:3, 3] + seen.values[:, :3]
        return tuple(seen.position[a] - there[:, a] for a in range(3))

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """The shift itself."""
        return tuple(shift)

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """``−e_axis`` for a shift, the change of ``−R m`` for a turn."""
        if axis < 3:
            return tuple(-1.0 if a == axis else 0.0 for a in range(3))
        moved = self._turned(seen, axis - 3)
        return tuple(-moved[:, a] for a in range(3))

    def described(self, place: str, values: Array) -> dict[str, Json]:
        """Pose of the tracker's frame in the world [m, rad]."""
        found: dict[str, Json] = dict(zip("xyz", map(float, self.frame[:3, 3] + values[:3]), strict=True))
        return found | roll_pitch_yaw(self.frame[:3, :3] @ turned_by(values[None, 3:6])[0])

    def _turned(self, seen: Seen, by: int | None = None) -> Array:
        """(N, 3) R₀ Rz Ry Rx m, or its derivative by one of the turns."""
        turned = np.einsum("nij,nj->ni", turned_by(seen.values[:, 3:6], by), seen.reading[:, :3])
        return np.asarray(turned @ self.frame[:3, :3].T)
