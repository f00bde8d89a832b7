"""Touches of fixed, unknown points: sockets, centre marks, a tip in the cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from posture_opt.measurements.kinds.kind import Kind, Seen, Slots, stacked
from posture_opt.numerics import Array


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
