"""Position of the tool point, as a tracker measures it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, Vector
from posture_opt.numerics import Codes, Mask


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
