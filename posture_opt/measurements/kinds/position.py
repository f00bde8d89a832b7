"""Position of the tool point, as a tracker measures it."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from posture_opt.measurements.kinds.free_frame import FRAME_UNKNOWNS, FreeFrame, described_pose
from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, Vector, stacked
from posture_opt.numerics import Array, Codes, Json, Mask

COORDINATES = ("x", "y", "z")
"""Columns of the measured tool point."""


@dataclass(frozen=True, eq=False)
class Position(Kind):
    """``h = p``, the measured coordinates of the tool point."""

    kind: ClassVar[str] = "position"
    noun: ClassVar[str] = "positions"
    fixed_to_base: ClassVar[bool] = False
    leaves_geometry_open: ClassVar[bool] = False
    example: ClassVar[str] = "x [mm], y [mm], z [mm]"

    @classmethod
    def columns_in(cls, data: object) -> Mapping[str, str]:
        """The coordinates."""
        return dict.fromkeys(COORDINATES, "length")

    @classmethod
    def required(cls, data: object, there: Container[str]) -> frozenset[str]:
        """Those of the coordinates that are there: an arm may not move along all."""
        return frozenset(name for name in COORDINATES if name in there)

    @property
    def read_columns(self) -> Mapping[str, str]:
        """The coordinates."""
        return dict.fromkeys(COORDINATES, "length")

    def axes(self, measured: Mask) -> Codes:
        """The coordinates that were measured."""
        return np.flatnonzero(measured)

    def in_own_frame(self) -> FramedPosition:
        """Positions in the frame of a tracker."""
        return FramedPosition()

    def error(self, seen: Seen) -> Slots:
        """``p − m``, in all three coordinates: those that were not measured hold the nominal model's value."""
        return tuple(seen.position[a] - seen.reading[:, a] for a in range(3))

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """The shift itself."""
        return tuple(shift)


@dataclass(frozen=True, eq=False)
class FramedPosition(Kind):
    """``p = T m``: positions m that a tracker measures in a frame T of its own, beside other readings.

    Errors are in the axes of the world.

    Args:
        frame: T_world_tracker, about the one that suits the nominal arm.
    """

    kind: ClassVar[str] = "position"
    noun: ClassVar[str] = "positions"

    frame: FreeFrame = field(default_factory=FreeFrame)

    @property
    def read_columns(self) -> Mapping[str, str]:
        """The coordinates."""
        return dict.fromkeys(COORDINATES, "length")

    def axes(self, measured: Mask) -> Codes:
        """All three coordinates."""
        return np.arange(3)

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> FramedPosition:
        """The frame that suits the nominal arm best."""
        return replace(self, frame=FreeFrame.fitted(stacked(seen.position, len(seen.place)), seen.reading[:, :3]))

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        """The pose of the frame, about the reference."""
        return FRAME_UNKNOWNS

    def start(self, seen: Seen, places: int) -> Array:
        """Zeros: the reference suits the nominal arm."""
        return np.zeros((places, len(FRAME_UNKNOWNS)))

    def error(self, seen: Seen) -> Slots:
        """``p − T m``."""
        there = self.frame.placed(seen.values, seen.reading[:, :3])
        return tuple(seen.position[a] - there[:, a] for a in range(3))

    def slope(self, seen: Seen, shift: Vector, turn: Vector) -> Slots:
        """The shift itself."""
        return tuple(shift)

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """``−∂(T m)``."""
        return tuple(-moved for moved in self.frame.slope(seen.values, seen.reading[:, :3], axis))

    def expected(self, seen: Seen) -> Array:
        """The tool point in the frame of the tracker [m]."""
        return self.frame.seen_from(seen.values, stacked(seen.position, len(seen.place)))

    def described(self, place: str, values: Array) -> dict[str, Json]:
        """Pose of the tracker's frame in the world [m, rad]."""
        return described_pose(self.frame.pose(values))
