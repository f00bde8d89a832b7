"""Position of the tool point, as a tracker measures it."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, stacked
from posture_opt.measurements.rotations import FRAME_UNKNOWNS, FreeFrame, described_pose
from posture_opt.numerics import Array, Codes, Json, Mask

COORDINATES = ("x", "y", "z")  # Columns of the measured tool point


@dataclass(frozen=True, eq=False)
class Position(Kind):
    """``p = T m``, the measured coordinates of the tool point, in the world or in a tracker's own frame T.

    Errors are in the axes of the world.
    """

    kind: ClassVar[str] = "position"
    noun: ClassVar[str] = "positions"
    fixed_to_base: ClassVar[bool] = False
    leaves_geometry_open: ClassVar[bool] = False
    example: ClassVar[str] = "x [mm], y [mm], z [mm]"

    frame: FreeFrame | None = None  # T_world_tracker beside other readings; None: that of the world

    @classmethod
    def columns_in(cls, data: object) -> Mapping[str, str]:
        return dict.fromkeys(COORDINATES, "length")

    @classmethod
    def required(cls, data: object, there: Container[str]) -> frozenset[str]:
        """The coordinates that are there: an arm may not move along all."""
        return frozenset(name for name in COORDINATES if name in there)

    def axes(self, measured: Mask) -> Codes:
        return np.flatnonzero(measured) if self.frame is None else np.arange(3)

    def in_own_frame(self) -> Self:
        return replace(self, frame=FreeFrame())

    def prepared(self, seen: Seen, moving: Mask, up: Array) -> Self:
        if self.frame is None:
            return self
        return replace(self, frame=FreeFrame.fitted(stacked(seen.position, len(seen.place)), seen.reading[:, :3]))

    def unknowns(self, place: str) -> tuple[tuple[str, str], ...]:
        return () if self.frame is None else FRAME_UNKNOWNS

    def error(self, seen: Seen) -> Slots:
        """``p − T m`` in all three coordinates: unmeasured ones hold the nominal model's value."""
        read = seen.reading[:, :3]
        there = read if self.frame is None else self.frame.placed(seen.values, read)
        return tuple(seen.position[a] - there[:, a] for a in range(3))

    def unknown_slope(self, seen: Seen, axis: int) -> Slots:
        """``−∂(T m)``."""
        assert self.frame is not None, "a frame of its own"
        return tuple(-moved for moved in self.frame.slope(seen.values, seen.reading[:, :3], axis))

    def expected(self, seen: Seen) -> Array:
        """(N, 3) the tool point in the frame of the tracker [m]."""
        points = stacked(seen.position, len(seen.place))
        return points if self.frame is None else self.frame.seen_from(seen.values, points)

    def described(self, place: str, values: Array) -> dict[str, Json]:
        return {} if self.frame is None else described_pose(self.frame.pose(values))
